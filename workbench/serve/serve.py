"""A machine served from first to last: plant, session, protocol, and what is said of it."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from workbench.errors import InputError
from workbench.machine import Axis, Hoist
from workbench.serve.pace import ask_priority, lines
from workbench.serve.plant import live_machine
from workbench.serve.session import Say, Session
from workbench.serve.udp import UdpServer

ProtocolName = Literal["udp", "modbus", "opcua"]
PORTS: dict[str, int] = {"udp": 5560, "modbus": 5020, "opcua": 4840}
HIGHEST_RATE_HZ, LOWEST_RATE_HZ = 20_000.0, 1.0


class Server(Protocol):
    """A protocol at work. run returns when `until(now)` says so; it calls `listening` once clients may come."""

    port: int

    def run(self, until: Callable[[float], bool], listening: Callable[[], None]) -> None: ...

    def close(self) -> None: ...


@dataclass(frozen=True)
class Wish:
    """What is to be served. lock_step: a step for every command instead of a clock (UDP only)."""

    protocol: ProtocolName = "udp"
    rate_hz: float = 1000.0
    address: str = "127.0.0.1"
    port: int | None = None
    payload_kg: float = 0.0
    start_position_m: float | None = None
    watchdog_s: float = 0.1
    watchdog_brake: bool = True
    ready: tuple[str, ...] = ()
    send_every: int = 1
    lock_step: bool = False
    priority: bool = False

    def check(self) -> None:
        if not (math.isfinite(self.rate_hz) and LOWEST_RATE_HZ <= self.rate_hz <= HIGHEST_RATE_HZ):
            raise InputError(
                f"{self.rate_hz:g} Hz, expected {LOWEST_RATE_HZ:g} to {HIGHEST_RATE_HZ:g} Hz", place="rate_hz"
            )
        if not (math.isfinite(self.watchdog_s) and self.watchdog_s > 0.0):
            raise InputError(f"{self.watchdog_s:g} s, expected more than 0", place="watchdog_s")
        if self.lock_step and self.protocol != "udp":
            raise InputError(f"takes the protocol udp, not {self.protocol}", place="lock_step")


def serve(
    machine: Hoist | Axis,
    wish: Wish,
    say: Say,
    stop: threading.Event,
    *,
    for_s: float = math.inf,
    ready: Callable[[Session, int], None] = lambda session, port: None,
) -> dict[str, Any]:
    """Serves the machine until `stop` is set or `for_s` seconds are over; returns the session's last status.

    ready: is told the session and the port once clients may come. InputError where the port is taken, an extra is
    missing, or the machine cannot be served so.
    """
    wish.check()
    step_s = 1.0 / wish.rate_hz
    plant = live_machine(machine, step_s, wish.payload_kg, wish.start_position_m, wish.ready)
    session = Session(plant, step_s, wish.watchdog_s, watchdog_brake=wish.watchdog_brake, clock=time.monotonic, say=say)
    server = _server(session, wish)
    try:
        say(
            f"{machine.name}: plant at {wish.rate_hz:g} Hz by {wish.protocol} on {wish.address}, port {server.port}, "
            f"{_reach(wish.address)}. It {'hangs' if plant.has_brake else 'stands'} still until the first "
            f"{plant.kind.drive.quantity}; {plant.hold:.1f} {plant.kind.drive.unit} hold it."
        )
        for name in plant.left_out:
            say(f"{name} acts on the log's sensors and is not in the plant: signals here are the true ones")
        ends = time.monotonic() + for_s

        def until(now: float) -> bool:
            return stop.is_set() or now >= ends

        def listening() -> None:
            ready(session, server.port)

        if wish.priority:
            say(f"The plant runs {ask_priority()}.")
        if isinstance(server, UdpServer) and wish.lock_step:
            server.run_in_lock_step(until, listening)
        else:
            server.run(until, listening)
    finally:
        server.close()
    return session.status()


def last_words(status: dict[str, Any], *, lock_step: bool = False) -> list[str]:
    """What is said at the end: pace with its histogram, and what was not taken."""
    counts = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in sorted(status["counts"].items()))
    return [*([] if lock_step else lines(status["pace"])), f"Counts: {counts or 'no command came'}."]


def _reach(address: str) -> str:
    if address in ("127.0.0.1", "::1", "localhost"):
        return "reached from this computer only"
    return "reached from other computers too, by anybody: there is no login"


def _server(session: Session, wish: Wish) -> Server:
    port = PORTS[wish.protocol] if wish.port is None else wish.port
    if wish.protocol == "udp":
        return UdpServer(session, wish.address, port, wish.send_every)
    if wish.protocol == "modbus":
        from workbench.serve.modbus import ModbusServer

        return ModbusServer(session, wish.address, port)
    from workbench.serve.opcua import OpcUaServer

    return OpcUaServer(session, wish.address, port)


def chosen_ready(text: str | None, machine: Hoist | Axis) -> Sequence[str]:
    """Names of effects with commas between; `all`: the whole library but for sensors."""
    from workbench.effects import effects_for
    from workbench.plants import plant_of

    if text is None:
        return ()
    if text.strip() == "all":
        return [effect.id for effect in effects_for(plant_of(machine).kind).values() if not effect.on_sensor]
    return [name.strip() for name in text.split(",") if name.strip()]
