"""Modbus TCP and OPC UA: the points as registers and coils, or as nodes; docs/serve.md has addresses and names.

Both listen behind one gate: at most MOST_CLIENTS connections, one that is idle for IDLE_S is closed, what is malformed
ends its connection and is counted, and one line in five seconds tells of it. A torque is a command, also one of the
same value: it feeds the watchdog.
"""

from __future__ import annotations

import asyncio
import contextlib
import datetime
import hmac
import logging
import socket
import struct
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from typing import Any

from workbench.core.errors import InputError
from workbench.serve.session import Point, Session, run_at_pace
from workbench.serve.udp import bound, shown

MOST_CLIENTS, IDLE_S = 32, 60.0


class MalformedError(Exception):
    """Bytes that are none of the protocol's; they end the connection."""


class TcpServer(ABC):
    """The plant in a thread of its own at its pace, its clients here. InputError where the port is taken."""

    def __init__(self, session: Session, address: str, port: int, token: str = "") -> None:
        self.session, self.address, self.token = session, address, token
        self._socket = bound(address, port, socket.SOCK_STREAM)
        self.port: int = self._socket.getsockname()[1]
        self._clients: set[asyncio.Task[Any] | None] = set()

    def close(self) -> None:
        self._socket.close()

    def run(self, until: Callable[[float], bool], listening: Callable[[], None]) -> None:
        """In real time until `until(now)`."""
        asyncio.run(self._serve(until, listening))

    async def _serve(self, until: Callable[[float], bool], listening: Callable[[], None]) -> None:
        asyncio.get_running_loop().set_exception_handler(
            lambda _, context: self.session.refused("malformed", str(context.get("exception") or context["message"]))
        )
        async with contextlib.AsyncExitStack() as stack:
            beside = await self.begin(stack)
            server = await asyncio.start_server(self._accept, sock=self._socket, backlog=MOST_CLIENTS)
            ended = threading.Event()

            def plant() -> None:
                try:
                    run_at_pace(self.session.pace, self.session.step, until)
                finally:
                    ended.set()

            threading.Thread(target=plant, name="plant", daemon=True).start()
            listening()
            try:
                while not ended.is_set():
                    await asyncio.sleep(0.05)
                    await beside()
            finally:
                server.close()
                clients = [task for task in self._clients if task is not None]
                for task in clients:
                    task.cancel()
                await asyncio.gather(*clients, return_exceptions=True)

    async def begin(self, stack: contextlib.AsyncExitStack) -> Callable[[], Any]:
        """What is to be done before clients may come; returns what is done twenty times a second."""
        return lambda: asyncio.sleep(0.0)

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        who = shown(writer.get_extra_info("peername") or ("?", 0))
        if len(self._clients) >= MOST_CLIENTS:
            self.session.refused("connection", f"{who} is not let in: {MOST_CLIENTS} connections are open")
            writer.transport.abort()
            return
        task = asyncio.current_task()
        self._clients.add(task)
        try:
            await self.talk(reader, writer, who)
        except TimeoutError:
            self.session.counts["idle_closed"] += 1
        except MalformedError as error:
            self.session.refused("malformed", f"{who} sent {error}; its connection is closed")
        except (OSError, asyncio.IncompleteReadError):  # the client has gone
            pass
        finally:
            self._clients.discard(task)
            writer.transport.abort()

    def not_taken(self, error: InputError) -> bool:
        """Counts what was written in vain; whether it was because another client controls."""
        only = error.problem.startswith("read only")
        self.session.refused("second_client" if only else "value", str(error))
        return only

    @abstractmethod
    async def talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, who: str) -> None:
        """With one client until it goes. TimeoutError where it is idle, MalformedError for what it must not send."""


# Modbus: MODBUS Application Protocol V1.1b3; numbers are float32, two registers each, the high word first. Addresses
# count from 0 in the order of the points.
MBAP = struct.Struct(">HHHB")  # transaction, protocol 0, bytes that follow the length, unit
READ_COILS, READ_DISCRETE, READ_HOLDING, READ_REGISTERS = 1, 2, 3, 4
WRITE_COIL, WRITE_REGISTER, WRITE_COILS, WRITE_REGISTERS = 5, 6, 15, 16
NO_FUNCTION, NO_ADDRESS, NO_VALUE, BUSY = 1, 2, 3, 6  # exceptions; busy: another client controls
MOST_BITS, MOST_REGISTERS, MOST_FLOAT = 2000, 125, 3.4028234e38
TOKEN_AT, TOKEN_REGISTERS = 60_000, 8  # where a token is written, two characters a register


class ModbusError(Exception):
    """An exception of the protocol, by its number."""


class ModbusServer(TcpServer):
    """Holding registers: what may be written (function 3, 6, 16); input registers: what is read (4); coils: switches
    that may be written (1, 5, 15); discrete inputs: switches that are read (2)."""

    def __init__(self, session: Session, address: str, port: int, token: str = "") -> None:
        super().__init__(session, address, port, token)
        self._tables = {
            function: tuple(point for point in points if point.kind == kind)
            for function, points, kind in (
                (READ_COILS, session.inputs, "switch"), (READ_DISCRETE, session.outputs, "switch"),
                (READ_HOLDING, session.inputs, "number"), (READ_REGISTERS, session.outputs, "number"),
            )
        }  # fmt: skip

    async def talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, who: str) -> None:
        let_in = not self.token
        while True:
            async with asyncio.timeout(IDLE_S):
                transaction, protocol, length, unit = MBAP.unpack(await reader.readexactly(MBAP.size))
                if protocol != 0 or not 2 <= length <= 254:
                    raise MalformedError("what is no Modbus TCP frame")
                request = await reader.readexactly(length - 1)
            try:
                answer = self._answer(request, who) if let_in else self._logged_in(request, who)
                let_in = True
            except ModbusError as error:
                answer = bytes([request[0] | 0x80, error.args[0]])
            except struct.error:  # fewer bytes than the function has
                answer = bytes([request[0] | 0x80, NO_VALUE])
            async with asyncio.timeout(IDLE_S):
                writer.write(MBAP.pack(transaction, 0, len(answer) + 1, unit) + answer)
                await writer.drain()

    def _logged_in(self, request: bytes, who: str) -> bytes:
        """The answer to the token in its registers; anything else is no function yet."""
        head = struct.pack(">BHHB", WRITE_REGISTERS, TOKEN_AT, TOKEN_REGISTERS, 2 * TOKEN_REGISTERS)
        given = request[len(head) :] if request.startswith(head) else b""
        if hmac.compare_digest(given, self.token.encode().ljust(2 * TOKEN_REGISTERS, b"\0")):
            return request[:5]
        self.session.refused("token", f"{who} gave no token or the wrong one")
        raise ModbusError(NO_FUNCTION)

    def _answer(self, request: bytes, who: str) -> bytes:
        function = request[0]
        if function in self._tables:
            return self._read(function, *struct.unpack_from(">HH", request, 1))
        if function == WRITE_COIL:
            address, value = struct.unpack_from(">HH", request, 1)
            if value not in (0, 0xFF00):
                raise ModbusError(NO_VALUE)
            self._write(READ_COILS, address, [value > 0], who)
            return request
        if function == WRITE_REGISTER:
            raise ModbusError(NO_VALUE)  # a number is two registers
        if function not in (WRITE_COILS, WRITE_REGISTERS):
            raise ModbusError(NO_FUNCTION)
        address, count, size = struct.unpack_from(">HHB", request, 1)
        data, bits = request[6:], function == WRITE_COILS
        if not count or not size == len(data) == (-(-count // 8) if bits else 2 * count):
            raise ModbusError(NO_VALUE)
        if bits:
            self._write(READ_COILS, address, [data[i // 8] >> (i % 8) & 1 for i in range(count)], who)
        elif address % 2 or count % 2:  # a number is two registers and begins at an even one
            raise ModbusError(NO_VALUE)
        else:
            self._write(READ_HOLDING, address // 2, struct.unpack(f">{count // 2}f", data), who)
        return request[:5]

    def _read(self, function: int, address: int, count: int) -> bytes:
        bits = function in (READ_COILS, READ_DISCRETE)
        points, width = self._tables[function], 1 if bits else 2
        if not 1 <= count <= (MOST_BITS if bits else MOST_REGISTERS):
            raise ModbusError(NO_VALUE)
        if address + count > width * len(points):
            raise ModbusError(NO_ADDRESS)
        with self.session.lock:
            chosen = points[address // width : (address + count - 1) // width + 1]
            values = [point.read(self.session) for point in chosen]
        if bits:
            data = sum(1 << i for i, value in enumerate(values) if value).to_bytes(-(-count // 8), "little")
        else:  # what float32 cannot hold becomes its largest
            whole = struct.pack(f">{len(values)}f", *(min(max(value, -MOST_FLOAT), MOST_FLOAT) for value in values))
            data = whole[2 * (address % 2) :][: 2 * count]
        return bytes([function, len(data)]) + data

    def _write(self, function: int, first: int, values: Sequence[float], who: str) -> None:
        points = self._tables[function][first : first + len(values)]
        if len(points) < len(values):
            raise ModbusError(NO_ADDRESS)
        try:
            self.session.set({point.name: value for point, value in zip(points, values, strict=True)}, who)
        except InputError as error:
            raise ModbusError(BUSY if self.not_taken(error) else NO_VALUE) from error


# OPC UA: nodes Plant/Inputs/NAME may be written, Plant/Outputs/NAME are read, numbers as Double, switches as Boolean.
NAMESPACE = "urn:workbench:plant"
CHUNK = struct.Struct("<3scI")  # OPC 10000-6, 7.1.2.2: type, chunk, bytes with this head
FIRST, LATER, MOST_CHUNK = (b"HEL",), (b"OPN", b"MSG", b"CLO", b"ERR"), 1 << 20

_writer: ContextVar[str | None] = ContextVar("_writer", default=None)


class OpcUaServer(TcpServer):
    """asyncua's server on a port of this computer alone, and before it the gate that its clients come through.

    Without encryption: a token, where one is asked for, is the password of any user name.
    """

    def __init__(self, session: Session, address: str, port: int, token: str = "") -> None:
        try:
            import asyncua  # noqa: F401 - optional and heavy
        except ImportError as error:
            raise InputError("the protocol opcua needs the extra 'serve': pip install '.[serve]'") from error
        super().__init__(session, address, port, token)
        self._users = 0

    async def begin(self, stack: contextlib.AsyncExitStack) -> Callable[[], Any]:
        from asyncua import Server, ua
        from asyncua.common.callback import CallbackType

        stack.enter_context(_one_line_for(logging.getLogger("asyncua"), self.session))
        server = Server(user_manager=self)
        await server.init()
        server.set_endpoint(f"opc.tcp://{self.address}:{self.port}/")
        self._inside = bound("127.0.0.1", 0, socket.SOCK_STREAM)
        server.socket_address = self._inside.getsockname()
        self._inside.close()
        server.set_server_name("workbench plant")
        server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        server.set_identity_tokens([ua.UserNameIdentityToken, *([] if self.token else [ua.AnonymousIdentityToken])])
        server.subscribe_server_callback(CallbackType.PreWrite, lambda event, _: _writer.set(event.user.name))
        space = await server.register_namespace(NAMESPACE)
        plant = await server.nodes.objects.add_object(ua.NodeId("Plant", space), f"{space}:Plant")
        shown_nodes = []
        for folder, points in (("Inputs", self.session.inputs), ("Outputs", self.session.outputs)):
            parent = await plant.add_object(ua.NodeId(f"Plant.{folder}", space), f"{space}:{folder}")
            for point in points:
                node = await self._node(server, parent, point, ua.NodeId(f"Plant.{folder}.{point.name}", space))
                if folder == "Outputs":
                    shown_nodes.append((point, node))
        await server.start()
        stack.push_async_callback(server.stop)
        self._inner = server.socket_address

        async def refresh() -> None:
            """For clients that subscribe; who reads gets the value of now."""
            for point, node in shown_nodes:
                await server.write_attribute_value(node.nodeid, self._now(point))
                server.set_attribute_value_callback(node.nodeid, lambda *_, point=point: self._now(point))

        return refresh

    def get_user(self, iserver: Any, username: Any = None, password: Any = None, certificate: Any = None) -> Any:
        """asyncua asks who a client is: each session is a user of its own; None where the token is wrong."""
        from asyncua.crypto.permission_rules import User, UserRole

        if self.token and not hmac.compare_digest(str(password or "").encode(), self.token.encode()):
            self.session.refused("token", "an OPC UA client gave no token or the wrong one")
            return None
        self._users += 1
        return User(role=UserRole.User, name=f"OPC UA session {self._users}")

    async def _node(self, server: Any, parent: Any, point: Point, at: Any) -> Any:
        from asyncua import ua

        node = await parent.add_variable(at, f"{at.NamespaceIndex}:{point.name}", self._now(point).Value.Value)
        unit = f" ({point.unit})" if point.unit else ""
        described = ua.DataValue(ua.Variant(ua.LocalizedText(f"{point.meaning}{unit}")))
        await node.write_attribute(ua.AttributeIds.Description, described)
        if point.write is not None:
            await node.set_writable()
            server.set_attribute_value_setter(node.nodeid, self._setter(point))
        server.set_attribute_value_callback(node.nodeid, lambda *_: self._now(point))
        return node

    def _setter(self, point: Point) -> Callable[[Any, Any, Any], None]:
        """Takes what a client writes. UaStatusCodeError, which the client sees, for a value that cannot be, and where
        another client controls."""
        from asyncua import ua

        def set_value(data: Any, attribute: Any, value: Any) -> None:
            try:
                self.session.set({point.name: getattr(value.Value, "Value", None)}, _writer.get())
            except InputError as error:
                denied, codes = self.not_taken(error), ua.StatusCodes
                raise ua.UaStatusCodeError(codes.BadUserAccessDenied if denied else codes.BadOutOfRange) from error

        return set_value

    def _now(self, point: Point) -> Any:
        from asyncua import ua

        with self.session.lock:
            value = point.read(self.session)
        variant = ua.Variant(bool(value) if point.kind == "switch" else float(value))
        return ua.DataValue(variant, SourceTimestamp=datetime.datetime.now(datetime.UTC))

    async def talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, who: str) -> None:
        """Hands whole chunks on, both ways, until one end closes or both are idle."""
        within, inside = await asyncio.open_connection(*self._inner)
        last = [time.monotonic()]

        async def up() -> None:
            allowed: tuple[bytes, ...] = FIRST
            while True:
                head = await reader.readexactly(CHUNK.size)
                kind, chunk, size = CHUNK.unpack(head)
                if kind not in allowed or chunk not in b"FCA" or not CHUNK.size <= size <= MOST_CHUNK:
                    raise MalformedError("what is no OPC UA chunk")
                inside.write(head + await reader.readexactly(size - CHUNK.size))
                await inside.drain()
                allowed, last[0] = LATER, time.monotonic()

        async def down() -> None:
            while data := await within.read(1 << 16):
                writer.write(data)
                await writer.drain()
                last[0] = time.monotonic()

        async def idle() -> None:
            while (left := last[0] + IDLE_S - time.monotonic()) > 0.0:
                await asyncio.sleep(left)
            raise TimeoutError

        tasks = [asyncio.ensure_future(work()) for work in (up, down, idle)]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            inside.transport.abort()


@contextlib.contextmanager
def _one_line_for(logger: logging.Logger, session: Session) -> Iterator[None]:
    """What a library logs as an error is counted and worded by the session, once in five seconds; nothing else."""

    class Handler(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            reason = record.exc_info[1] if record.exc_info else None
            session.refused("malformed", f"{record.getMessage()}{f': {reason!r}' if reason is not None else ''}")

    before = logger.handlers, logger.level, logger.propagate
    logger.handlers, logger.propagate = [Handler()], False
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.handlers, logger.propagate = before[0], before[2]
        logger.setLevel(before[1])
