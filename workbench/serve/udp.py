"""UDP, version 2: one packet in, one packet out; docs/serve.md has their layout.

Command, 40 bytes, little endian: "WBC2", byte order uint32, sequence uint32, flags uint32 (bit 0: the brake holds), the
input float64 (of a hoist the torque of all motors, N m), the token in 16 bytes, zero where none is asked for.
State: "WBS2", byte order, sequence, sequence of the last command, flags (bits of `points.FLAGS`), steps left out, all
uint32; then each number among the outputs as float64.
A datagram that begins with "{" is an order in JSON (see `Session.order`), answered in JSON.
"""

from __future__ import annotations

import hmac
import json
import select
import socket
import struct
import time
from collections.abc import Callable, Iterator

from workbench.core.errors import InputError, one_line
from workbench.serve.session import Session, run_at_pace

BYTE_ORDER = 0x01020304  # a sender of the other byte order writes it as 0x04030201
COMMAND = struct.Struct("<4sIIId16s")
STATE_HEAD = struct.Struct("<4sIIIII")
COMMAND_MAGIC, STATE_MAGIC = b"WBC2", b"WBS2"
BRAKE_BIT = 1
MOST_BYTES = 65_536
MOST_A_STEP, DRAIN_SHARE = 1000, 0.5  # datagrams, and share of a step, that are read before it: a flood stops no time
SILENT_S = 1.0  # states stop so long after the last command: nobody is sent more than he asks for
REMINDED_EVERY_S = 1.0  # how often a client that may only read is told so

Address = tuple[str, int]


class UdpServer:
    """The socket of one session. InputError where the port is taken or not ours."""

    def __init__(self, session: Session, address: str, port: int, send_every: int, token: str, lock_step: bool) -> None:
        """lock_step: a step for every command, as fast as they come; for tests of a controller, without a clock."""
        self._lock_step = lock_step
        self._session, self._every, self._token = session, send_every, token.encode().ljust(16, b"\0")
        self._numbers = [point.read for point in session.outputs if point.kind == "number"]
        self._state = struct.Struct(f"{STATE_HEAD.format}{len(self._numbers)}d")
        self._client: Address | None = None
        self._sequence = self._echo = 0
        self._reminded_s = float("-inf")
        self._socket = bound(address, port, socket.SOCK_DGRAM)
        self.port: int = self._socket.getsockname()[1]

    def close(self) -> None:
        self._socket.close()

    def run(self, until: Callable[[float], bool], listening: Callable[[], None]) -> None:
        """Until `until(now)`, in real time or in lock step."""
        listening()
        if not self._lock_step:
            run_at_pace(self._session.pace, self._tick, until, self._wait)
        while not until(time.monotonic()):
            for commanded in self._drain() if self._readable(0.05) else ():
                if commanded:
                    self._session.step(live=False)
                    self._send()

    def _readable(self, seconds: float) -> bool:
        return bool(select.select([self._socket], [], [], seconds)[0])

    def _wait(self, seconds: float) -> None:
        """Takes commands as they come, so that a silent second is no queue of a second."""
        if self._readable(min(seconds, 0.1)):
            list(self._drain())

    def _tick(self) -> None:
        list(self._drain())
        session = self._session
        session.step()
        if session.counts["steps"] % self._every == 0 and session.clock() - session.heard_s <= SILENT_S:
            self._send()

    def _drain(self) -> Iterator[bool]:
        """Every waiting datagram, as far as there is time; True for each command that was taken."""
        ends = time.monotonic() + max(DRAIN_SHARE * self._session.step_s, 1e-4)
        for _ in range(MOST_A_STEP):
            try:
                data, sender = self._socket.recvfrom(MOST_BYTES)
            except (BlockingIOError, InterruptedError):
                return
            except OSError:  # an answer to a client that has gone
                continue
            if data[:1] == b"{":
                self._order(data, sender)
            else:
                yield self._command(data, sender)
            if time.monotonic() > ends:
                return

    def _command(self, data: bytes, sender: Address) -> bool:
        """Whether the datagram was a command, and was taken."""
        session, who = self._session, shown(sender)
        if (fault := _fault(data)) is not None:
            session.refused(fault[0], f"packet from {who} {fault[1]}; it is not used")
            return False
        _, _, sequence, flags, value, token = COMMAND.unpack(data)
        if not self._may(token, who):
            return False
        try:
            taken = session.command(value, bool(flags & BRAKE_BIT) if session.plant.has_brake else None, who)
        except InputError as error:
            session.refused("second_client", f"{who} is not heard: {error.problem}")
            if session.clock() - self._reminded_s >= REMINDED_EVERY_S:
                self._reminded_s = session.clock()
                self._answer({"error": str(error)}, sender)
            return False
        if taken:
            self._client, self._echo = sender, sequence
        return taken

    def _may(self, token: bytes, who: str) -> bool:
        """Whether the token fits; who has the wrong one gets no answer."""
        if hmac.compare_digest(token, self._token) or not self._token.strip(b"\0"):
            return True
        self._session.refused("token", f"{who} gave the wrong token; it gets no answer")
        return False

    def _order(self, data: bytes, sender: Address) -> None:
        try:
            order = json.loads(data)
            token = str(order.pop("token", "")) if isinstance(order, dict) else ""
            if not self._may(token.encode(errors="replace").ljust(16, b"\0"), shown(sender)):
                return
            answer = self._session.order(order, shown(sender))
        except InputError as error:
            answer = {"error": str(error)}
        except (ValueError, RecursionError) as error:
            if self._token.strip(b"\0"):
                self._session.refused("token", f"{shown(sender)} sent what is no JSON; it gets no answer")
                return
            answer = {"error": one_line(f"is no JSON: {error}", 300)}
        if "error" in answer:
            self._session.refused("order", f"order from {shown(sender)}: {answer['error']}")
        self._answer(answer, sender)

    def _answer(self, answer: dict[str, object], to: Address) -> None:
        self._to(json.dumps(answer).encode(), to)

    def _send(self) -> None:
        if self._client is None:
            return
        session, self._sequence = self._session, (self._sequence + 1) & 0xFFFFFFFF
        skipped = round(session.skipped_s / session.step_s) & 0xFFFFFFFF
        head = (STATE_MAGIC, BYTE_ORDER, self._sequence, self._echo, session.flags, skipped)
        self._to(self._state.pack(*head, *(read(session) for read in self._numbers)), self._client)

    def _to(self, data: bytes, address: Address) -> None:
        try:
            self._socket.sendto(data, address)
        except OSError:  # full, or nobody there: the next state is newer
            self._session.counts["not_sent"] += 1


def _fault(data: bytes) -> tuple[str, str] | None:
    """What a datagram is counted as, and what is wrong with it; None for a command."""
    if data[:4] != COMMAND_MAGIC:
        old = ": version 1 of the protocol, this is version 2" if data[:4] == b"WBC1" else ""
        return "magic", f"begins with {data[:4]!r}, expected {COMMAND_MAGIC!r}{old}"
    if len(data) != COMMAND.size:
        word = "short" if len(data) < COMMAND.size else "long"
        return "size", f"has {len(data)} bytes, which is too {word}: expected {COMMAND.size}"
    order = COMMAND.unpack(data)[1]
    if order != BYTE_ORDER:
        return "byte_order", f"is not little endian: byte order {order:#010x}, expected {BYTE_ORDER:#010x}"
    return None


def shown(address: Address) -> str:
    return f"{address[0]}:{address[1]}"


def bound(address: str, port: int, kind: socket.SocketKind) -> socket.socket:
    """A socket with its port that does not block. InputError where the port is taken or not ours."""
    try:
        family = socket.getaddrinfo(address, port, type=kind)[0][0]
        made = socket.socket(family, kind)
    except (OSError, UnicodeError) as error:
        raise InputError(f"address {address} is not known: {error}", place="address") from error
    try:
        if kind == socket.SOCK_STREAM:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind((address, port))
    except OSError as error:
        made.close()
        said = f"port {port} of {address} is taken or not ours to use ({error.strerror}); choose another"
        raise InputError(said, place="port") from error
    made.setblocking(False)
    return made
