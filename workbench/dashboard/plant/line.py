"""How a plant is reached: as a session of this process, or over UDP on this computer."""

from __future__ import annotations

import json
import socket
import threading
import time
from dataclasses import dataclass
from typing import Any, Protocol

from workbench.errors import InputError
from workbench.plants import HOIST
from workbench.serve.points import BRAKE, FLAGS, TORQUE
from workbench.serve.session import Session
from workbench.serve.udp import BRAKE_BIT, MOST_BYTES, command_packet, state_in

HERE = "127.0.0.1"  # a page reaches plants of this computer only
ANSWERS_WITHIN_S = 1.0
BITS = {name: 1 << bit for bit, (name, _) in enumerate(FLAGS)}
SIGNALS = tuple(signal.name for signal in HOIST.signals)
SWITCHES = tuple(f"is_{name}" for name, _ in FLAGS)
READ = ("time_s", TORQUE, "torque_at_work_nm", *SIGNALS, "payload_now_kg", *SWITCHES)  # what is recorded


class OtherClientError(Exception):
    """Somebody else commands this plant."""


@dataclass(frozen=True)
class Seen:
    """What a client knows of the plant. torque_nm: at work, of all motors; flags: bits of `serve.points.FLAGS`."""

    time_s: float
    torque_nm: float
    signals: dict[str, float]
    flags: int

    def told(self, flag: str) -> bool:
        return bool(self.flags & BITS[flag])


class Line(Protocol):
    """One end of a line to a plant."""

    def order(self, order: dict[str, Any]) -> dict[str, Any]:
        """As `Session.order`. InputError for what it refuses, and for a plant that does not answer."""
        ...

    def seen(self) -> Seen | None:
        """The latest state, for a client; None before a state is there."""
        ...

    def numbers(self) -> dict[str, float]:
        """All of `READ`, for whoever looks on. InputError for a plant that does not answer."""
        ...

    def command(self, torque_nm: float) -> None:
        """Torque of all motors. OtherClientError where another client has the plant."""
        ...

    def release(self) -> None:
        """Before the first command of a client."""
        ...


class OwnLine:
    """To a session of this process, whatever protocol serves it."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._commands: int | None = None  # counted by the session when this end gave its last one

    def order(self, order: dict[str, Any]) -> dict[str, Any]:
        return self._session.order(order)

    def seen(self) -> Seen:
        with self._session.lock:
            plant = self._session.plant
            return Seen(plant.time_s, plant.torque_nm, dict(plant.signals), self._session.flags)

    def numbers(self) -> dict[str, float]:
        with self._session.lock:  # held shortly: the next step waits for it
            seen, asked, payload = self.seen(), self._session.torque_nm, self._session.plant.payload_kg
        told = {name: float(seen.flags >> bit & 1) for bit, name in enumerate(SWITCHES)}
        first = {"time_s": seen.time_s, TORQUE: asked, "torque_at_work_nm": seen.torque_nm}
        return {**first, **seen.signals, "payload_now_kg": payload, **told}

    def command(self, torque_nm: float) -> None:
        with self._session.lock:
            if self._commands is not None and self._session.counts["commands"] != self._commands:
                raise OtherClientError
            self._session.command(torque_nm)
            self._commands = self._session.counts["commands"]

    def release(self) -> None:
        self._commands = None


class UdpLine:
    """To a plant that another process of this computer serves over UDP."""

    def __init__(self, port: int) -> None:
        self._line = _socket(port)  # one socket: the plant knows its controller by it
        self._port, self._sequence = port, 0
        self._one_at_a_time = threading.Lock()
        self._seen: Seen | None = None
        self._unanswered = 0
        self._brake = False  # every command says it anew

    def order(self, order: dict[str, Any]) -> dict[str, Any]:
        with self._one_at_a_time:
            ends = time.monotonic() + ANSWERS_WITHIN_S
            try:
                self._line.send(json.dumps(order).encode())
                while not (data := self._receive(ends - time.monotonic())).startswith(b"{"):
                    pass
                answer: dict[str, Any] = json.loads(data)
            except (OSError, ValueError) as error:
                said = f"no plant answers over UDP on port {self._port} of this computer"
                raise InputError(f"{said}; start one with `workbench serve`", place="port") from error
        if "error" in answer:
            raise InputError(str(answer["error"]))
        self._brake = bool(order.get("set", {}).get(BRAKE, self._brake))
        return answer

    def _receive(self, within_s: float) -> bytes:
        """The next datagram; a state becomes the latest one. OSError where none comes."""
        self._line.settimeout(max(within_s, 0.0))
        data = self._line.recv(MOST_BYTES)
        if (state := state_in(data)) is not None:
            self._unanswered = 0
            self._seen = Seen(state.time_s, state.at_work, state.signals, state.flags)
        return data

    def seen(self) -> Seen | None:
        if self._one_at_a_time.acquire(blocking=False):  # an order that waits for its answer reads the states too
            try:
                while True:
                    self._receive(0.0)
            except OSError:
                pass
            finally:
                self._one_at_a_time.release()
        return self._seen

    def numbers(self) -> dict[str, float]:
        read: dict[str, float] = self.order({"get": list(READ)})["get"]
        return read

    def command(self, torque_nm: float) -> None:
        self._unanswered += 1
        if self._unanswered > 100:  # a plant answers its client and nobody else
            raise OtherClientError
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        try:
            self._line.send(command_packet(self._sequence, torque_nm, BRAKE_BIT * self._brake))
        except OSError:
            return

    def release(self) -> None:
        self._unanswered, self._seen = 0, None


def _socket(port: int) -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.connect((HERE, port))
    return made
