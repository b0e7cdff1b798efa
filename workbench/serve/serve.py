"""A machine served from first to last: plant, session, protocol, and the lines for whoever runs it."""

from __future__ import annotations

import contextlib
import ipaddress
import math
import os
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from workbench.core.errors import InputError
from workbench.effects import effects_for
from workbench.machines import Machine, plant_of
from workbench.serve.plant import live_machine
from workbench.serve.session import Say, Session
from workbench.serve.tcp import ModbusServer, OpcUaServer, TcpServer
from workbench.serve.udp import UdpServer

ProtocolName = Literal["udp", "modbus", "opcua"]
PORTS: dict[str, int] = {"udp": 5560, "modbus": 5020, "opcua": 4840}
HIGHEST_RATE_HZ, LOWEST_RATE_HZ = 20_000.0, 1.0
TOKEN_CHARACTERS = (8, 16)


@dataclass(frozen=True)
class Wish:
    """What is to be served. lock_step: a step for every command instead of a clock (UDP only). token: what clients have
    to show, "" for none; other addresses than this computer's own ask for one."""

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
    token: str = ""

    def check(self) -> None:
        """InputError for what cannot be."""
        lowest, highest = LOWEST_RATE_HZ, HIGHEST_RATE_HZ
        if not lowest <= self.rate_hz <= highest:
            raise InputError(f"{self.rate_hz:g} Hz, expected {lowest:g} to {highest:g} Hz", place="rate_hz")
        if not 0.0 < self.watchdog_s < math.inf:
            raise InputError(f"{self.watchdog_s:g} s, expected more than 0", place="watchdog_s")
        if self.lock_step and self.protocol != "udp":
            raise InputError(f"takes the protocol udp, not {self.protocol}", place="lock_step")
        least, most = TOKEN_CHARACTERS
        if self.token and not (least <= len(self.token) <= most and self.token.isascii() and self.token.isprintable()):
            raise InputError(f"expected {least} to {most} printable characters of ASCII", place="token")
        if not self.token and not self.local:
            reached = f"{self.address} is reached from other computers, where anybody may move the plant"
            raise InputError(f"{reached}: give a token too, see docs/deployment.md", place="address")

    @property
    def local(self) -> bool:
        """Whether only this computer reaches the address."""
        with contextlib.suppress(ValueError):
            return ipaddress.ip_address(self.address).is_loopback
        return self.address == "localhost"


def serve(
    machine: Machine,
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
    port = PORTS[wish.protocol] if wish.port is None else wish.port
    server: UdpServer | TcpServer
    if wish.protocol == "udp":
        server = UdpServer(session, wish.address, port, wish.send_every, wish.token, wish.lock_step)
    else:
        make = ModbusServer if wish.protocol == "modbus" else OpcUaServer
        server = make(session, wish.address, port, wish.token)
    for name in plant.left_out:
        session.say(f"{name} acts on the log's sensors and is not in the plant: signals here are the true ones")
    if wish.priority:
        session.say(f"The plant runs {ask_priority()}.")
    ends = time.monotonic() + for_s

    def listening() -> None:
        reached = "reached from this computer only" if wish.local else "reached from other computers with the token"
        drive = plant.kind.drive
        session.say(
            f"{machine.name}: plant at {wish.rate_hz:g} Hz by {wish.protocol} on {wish.address}, port {server.port}, "
            f"{reached}. It {'hangs' if plant.has_brake else 'stands'} still until the first {drive.quantity}; "
            f"{plant.hold:.1f} {drive.unit} hold it."
        )
        if wish.protocol == "opcua":
            session.say(f"Endpoint: opc.tcp://{wish.address}:{server.port}/")
        ready(session, server.port)

    def until(now: float) -> bool:
        return stop.is_set() or now >= ends

    try:
        server.run(until, listening)
    finally:
        server.close()
    return session.status()


def ask_priority() -> str:
    """Asks the system to run this thread before others; what came of it, in words."""
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(10))
    except (AttributeError, OSError):  # not this system, or not this user
        return (
            "at ordinary priority, for the system gives this user no other (it takes root, or rtprio in limits.conf): "
            "on a busy computer steps will be late"
        )
    return "at real-time priority"


def last_words(status: dict[str, Any], *, lock_step: bool = False) -> list[str]:
    """The last lines: pace with its histogram, and what was not taken."""
    counts = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in sorted(status["counts"].items()))
    return [*([] if lock_step else pace_lines(status["pace"])), f"Counts: {counts or 'no command came'}."]


def pace_lines(record: dict[str, Any]) -> list[str]:
    """The record of a pace in words, with the histogram."""
    head = (
        "{steps} steps at {rate_hz:g} Hz, {on_time_percent:.3f} % on time, {overruns} overruns, "
        "{skipped_s:.3f} s skipped, latest start {latest_start_ms:.2f} ms"
    ).format(**record)
    width, rows = max(map(len, record["jitter"])), []
    for name, count in record["jitter"].items():
        share = count / max(record["steps"], 1)
        rows.append(f"  {name:>{width}}  {count:>8}  {100.0 * share:7.3f} %  {'#' * round(40.0 * share)}")
    return [head, "How late steps began:", *rows]


def chosen_ready(text: str | None, machine: Machine) -> Sequence[str]:
    """Names of effects with commas between; `all`: the whole library but for sensors."""
    if text is None:
        return ()
    if text.strip() == "all":
        return [effect.id for effect in effects_for(plant_of(machine).kind).values() if not effect.on_sensor]
    return [name.strip() for name in text.split(",") if name.strip()]
