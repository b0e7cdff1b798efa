"""UDP: one packet in, one packet out; docs/serve.md has their layout.

Command, 24 bytes, little endian: "WBC1", sequence uint32, flags uint32 (bit 0: the brake holds), reserved uint32,
the input float64: of a hoist the torque of all motors, N m.
State, 112 bytes: "WBS1", sequence uint32, sequence of the last command uint32, flags uint32 (bits of `points.FLAGS`),
then float64: time_s, torque_at_work_nm, the plant's nine signals, payload_kg. An axis' state is shorter or longer: its
input at work, its own signals, and no payload.
A datagram that begins with "{" is an order in JSON (see `Session.order`), answered in JSON.
"""

from __future__ import annotations

import json
import select
import struct
import time
from collections.abc import Callable, Iterator

from workbench.errors import InputError
from workbench.serve.live import LiveMachine
from workbench.serve.pace import run_at_pace
from workbench.serve.plant import SIGNALS
from workbench.serve.ports import udp_socket
from workbench.serve.session import Session

COMMAND = struct.Struct("<4sIIId")
STATE = struct.Struct(f"<4sIII{len(SIGNALS) + 3}d")  # of a hoist; see `state_of`
COMMAND_MAGIC, STATE_MAGIC = b"WBC1", b"WBS1"
BRAKE_BIT = 1
MOST_BYTES = 65_536
MOST_A_STEP = 1000  # datagrams that are read before a step; a flood does not stop time

Address = tuple[str, int]


def state_of(plant: LiveMachine) -> struct.Struct:
    """The layout of a machine's state."""
    return struct.Struct(f"<4sIII{len(plant.shown) + 2 + plant.carries}d")


class UdpServer:
    """The socket of one session. One client at a time: the first one, until it is silent."""

    def __init__(self, session: Session, address: str, port: int, send_every: int = 1) -> None:
        self._session, self._every, self._state = session, send_every, state_of(session.plant)
        self._client: Address | None = None
        self._sequence = self._echo = 0
        self._socket = udp_socket(address, port)
        self.port: int = self._socket.getsockname()[1]

    def close(self) -> None:
        self._socket.close()

    def run(self, until: Callable[[float], bool], listening: Callable[[], None]) -> None:
        """In real time until `until(now)`."""
        listening()
        run_at_pace(self._session.pace, self._tick, until, self._wait)

    def run_in_lock_step(self, until: Callable[[float], bool], listening: Callable[[], None]) -> None:
        """A step for every command, as fast as they come; for tests of a controller, without a clock."""
        listening()
        while not until(time.monotonic()):
            if self._readable(0.05):
                for command in self._drain():
                    if command:
                        self._session.step(live=False)
                        self._send()

    def _readable(self, seconds: float) -> bool:
        return bool(select.select([self._socket], [], [], seconds)[0])

    def _wait(self, seconds: float) -> None:
        """Takes commands as they come, so that a silent second is no queue of a second."""
        if self._readable(min(seconds, 0.1)):
            for _ in self._drain():
                pass

    def _tick(self) -> None:
        for _ in self._drain():
            pass
        self._session.step()
        if self._session.counts["steps"] % self._every == 0:
            self._send()

    def _drain(self) -> Iterator[bool]:
        """Every waiting datagram; True for each command that was taken."""
        for _ in range(MOST_A_STEP):
            try:
                data, sender = self._socket.recvfrom(MOST_BYTES)
            except (BlockingIOError, InterruptedError):
                return
            except ConnectionError:  # an answer to a client that has gone
                continue
            if data[:1] == b"{":
                self._order(data, sender)
            else:
                yield self._command(data, sender)

    def _command(self, data: bytes, sender: Address) -> bool:
        session = self._session
        if len(data) != COMMAND.size:
            word = "too short" if len(data) < COMMAND.size else "too long"
            session.refused("size", f"packet of {len(data)} bytes from {shown(sender)} is {word}: "
                            f"expected {COMMAND.size}; it is not used")  # fmt: skip
            return False
        magic, sequence, flags, _, value = COMMAND.unpack(data)
        if magic != COMMAND_MAGIC:
            session.refused("magic", f"packet from {shown(sender)} begins with {magic!r}, expected {COMMAND_MAGIC!r}")
            return False
        if self._client not in (None, sender) and not (session.silent or session.waits):
            session.refused("second_client", f"{shown(sender)} is not heard: {shown(self._client)} has the plant")
            return False
        if not session.command(value, bool(flags & BRAKE_BIT) if session.plant.has_brake else None):
            return False
        self._client, self._echo = sender, sequence
        return True

    def _order(self, data: bytes, sender: Address) -> None:
        try:
            order = json.loads(data)
            answer = self._session.order(order)
        except (ValueError, RecursionError) as error:
            answer = {"error": f"is no JSON: {error}"}
        except InputError as error:
            answer = {"error": str(error)}
        if "error" in answer:
            self._session.refused("order", f"order from {shown(sender)}: {answer['error']}")
        self._to(json.dumps(answer).encode(), sender)

    def _send(self) -> None:
        if self._client is None:
            return
        session, self._sequence = self._session, (self._sequence + 1) & 0xFFFFFFFF
        plant = session.plant
        values = [plant.time_s, plant.at_work, *plant.signals.values()]
        if plant.carries:
            values.append(plant.payload_kg)
        self._to(self._state.pack(STATE_MAGIC, self._sequence, self._echo, session.flags, *values), self._client)

    def _to(self, data: bytes, address: Address) -> None:
        try:
            self._socket.sendto(data, address)
        except OSError:  # full, or nobody there: the next state is newer
            self._session.counts["not_sent"] += 1


def shown(address: Address | None) -> str:
    return "nobody" if address is None else f"{address[0]}:{address[1]}"
