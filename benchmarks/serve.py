"""The served plant under the sampled PI as its client: `python -m benchmarks.serve [--seconds 60]`.

Two figures: the share of steps on time at 1 kHz with a client that answers every state, and how far the metrics of a
closed loop at 250 Hz over UDP are from those of the study.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from workbench.control import PiSettings, full_pi, loop_values
from workbench.core.run import Array
from workbench.engine.stepped import Step, observe
from workbench.machines import HOIST, Axis, Hoist, default_hoist, save_machine
from workbench.metrics import observer
from workbench.references import Limits, motor_speed_rad_s, plan_motion
from workbench.references import Step as Way
from workbench.serve.serve import Wish, ask_priority, serve
from workbench.serve.session import Session
from workbench.serve.udp import BYTE_ORDER, COMMAND, COMMAND_MAGIC, STATE_HEAD, STATE_MAGIC
from workbench.simulate.loop import LoopCase, case_limits, simulate_loop

PAYLOAD_KG, START_M = 4500.0, 9.0


SIGNALS = tuple(signal.name for signal in HOIST.plant.signals)


@dataclass(frozen=True)
class State:
    """What a client reads out of a packet. numbers: the outputs that are numbers, in their order."""

    sequence: int
    echo: int
    flags: int
    skipped_steps: int
    numbers: tuple[float, ...]

    @property
    def time_s(self) -> float:
        return self.numbers[0]

    @property
    def at_work(self) -> float:
        return self.numbers[1]

    @property
    def signals(self) -> dict[str, float]:
        """Of a hoist, by name."""
        return dict(zip(SIGNALS, self.numbers[2:], strict=False))


def command_packet(sequence: int, value: float, flags: int = 0, token: str = "") -> bytes:
    return COMMAND.pack(COMMAND_MAGIC, BYTE_ORDER, sequence & 0xFFFFFFFF, flags, value, token.encode())


def state_in(data: bytes) -> State | None:
    """The state in a datagram, None where it is none."""
    count, rest = divmod(len(data) - STATE_HEAD.size, 8)
    if count < 2 or rest or data[:4] != STATE_MAGIC:
        return None
    _, _, sequence, echo, flags, skipped = STATE_HEAD.unpack_from(data)
    return State(sequence, echo, flags, skipped, struct.unpack_from(f"<{count}d", data, STATE_HEAD.size))


class Client:
    """One end of the line: a command out, a state in."""

    def __init__(self, port: int, token: str = "") -> None:
        self._line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._line.settimeout(5.0)
        self._line.connect(("127.0.0.1", port))
        self._sequence, self._token = 0, token

    def close(self) -> None:
        self._line.close()

    def send(self, torque_nm: float, flags: int = 0) -> None:
        self._sequence += 1
        self.send_bytes(command_packet(self._sequence, torque_nm, flags, self._token))

    def send_bytes(self, data: bytes) -> None:
        self._line.send(data)

    def receive(self) -> State:
        """The next state. TimeoutError after five seconds without one."""
        while (state := state_in(self._line.recv(65_536))) is None:
            pass
        return state

    def order(self, order: dict[str, Any]) -> dict[str, Any]:
        self._line.send(json.dumps({**order, "token": self._token}).encode())
        return self.answer()

    def answer(self) -> dict[str, Any]:
        while True:
            data = self._line.recv(65_536)
            if data[:1] == b"{":
                answer: dict[str, Any] = json.loads(data)
                return answer


class Served:
    """A machine served in a thread of this process, over UDP on a free port."""

    def __init__(self, machine: Hoist | Axis, said: list[str] | None = None, **wish: Any) -> None:
        self._stop, self._ready = threading.Event(), threading.Event()
        self.said: list[str] = [] if said is None else said
        self.status: dict[str, Any] = {}
        hangs = {"payload_kg": PAYLOAD_KG, "start_position_m": START_M} if isinstance(machine, Hoist) else {}
        self._wish = Wish(**{"port": 0, **hangs, **wish})
        self._thread = threading.Thread(target=self._run, args=(machine,), daemon=True)

    def _run(self, machine: Hoist | Axis) -> None:
        self.status = serve(machine, self._wish, self.said.append, self._stop, ready=self._begun)

    def _begun(self, session: Session, port: int) -> None:
        self.session, self.port = session, port
        self._ready.set()

    def __enter__(self) -> Served:
        self._thread.start()
        assert self._ready.wait(300.0), self.said
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(10.0)


def case_at(rate_hz: float, machine: Hoist) -> LoopCase:
    """A hoist by 0.8 m under the sampled PI."""
    settings = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0, sample_time_s=1.0 / rate_hz)
    limits, rail = Limits(0.5, 0.6, 2.0), (0.0, 25.0)
    plan = plan_motion("ruckig", [Way(by_m=0.8)], START_M, limits, rail, lead_s=0.2, settle_s=1.0)
    motion = plan.sample(settings.sample_time_s, 4.5)
    speed = motor_speed_rad_s(motion.speed_m_s, machine.gearbox.ratio, machine.winch.drum_diameter_m)
    return LoopCase("served", machine, PAYLOAD_KG, START_M, settings, speed)


def closed_loop(client: Client, case: LoopCase, every: int = 1) -> dict[str, float]:
    """The study's metrics of the loop that a client closes: the controller's own step here, the plant there.

    every: states of the plant to one sample of the controller.
    """
    machine, settings, dt = case.machine, case.controller, case.controller.sample_time_s
    first = client.order({"get": ["torque_motor_nm", *SIGNALS]})["get"]
    hold = float(first["torque_motor_nm"])
    controller = full_pi(machine.drive.speed_delay_s > 0.0)
    numbers = {
        **vars(HOIST.plant.values(machine, case.payload_kg)),
        **loop_values(settings, machine.drive, hold),
        **case_limits(case),
    }
    p = SimpleNamespace(**numbers)
    step = Step(controller, p, controller.start(p, hold, first["angle_motor_rad"]), dt)
    reference: Array = np.asarray(case.speed_reference_rad_s)
    rows = np.empty((len(reference), len(SIGNALS) + 1))
    signals, at_work = {name: float(first[name]) for name in SIGNALS}, hold
    for k, r in enumerate(reference):
        rows[k] = [*signals.values(), at_work]
        torque = step(float(r), k * dt, signals["speed_motor_rad_s"], signals["angle_motor_rad"])
        client.send(torque)
        until = (k + 1) * dt - 1e-9
        while (seen := client.receive()).time_s < until:
            if every == 1:
                break
        signals, at_work = seen.signals, seen.at_work
    run = {name: rows[:, i] for i, name in enumerate(SIGNALS)}
    run |= {"torque_motor_nm": rows[:, -1], "speed_reference_rad_s": reference}
    run["time_s"] = np.asarray(dt * np.arange(len(reference)), dtype=float)
    return observer().finish(observe(observer(), p, run, dt), p, len(reference) * dt)


def off_percent(metrics: dict[str, float], study: dict[str, float]) -> dict[str, float]:
    """How far each metric is from the study's, in per cent of the study's own; metrics that are zero left out."""
    return {
        name: 100.0 * abs(metrics[name] - value) / abs(value)
        for name, value in study.items()
        if math.isfinite(value) and abs(value) > 1e-6
    }


_ECHO = """
import socket, struct, sys
line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
line.connect(("127.0.0.1", int(sys.argv[1])))
line.settimeout(5)
command, hold, k = struct.Struct("<4sIIId16s"), float(sys.argv[2]), 0
try:
    while True:
        k += 1
        line.send(command.pack(b"WBC2", 0x01020304, k, 0, hold + (20.0 if k // 2000 % 2 else -20.0), b""))
        line.recv(200)
except OSError:
    pass
"""


def on_time(machine: Hoist, seconds: float) -> dict[str, Any]:
    """A status after so long at 1 kHz with a client in another process; peak memory of this one before and after."""
    with Served(machine, priority=True, watchdog_s=0.5) as served:
        words = [sys.executable, "-c", _ECHO, str(served.port), str(served.session.plant.hold)]
        client = subprocess.Popen(words)
        time.sleep(2.0)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        time.sleep(seconds)
        after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        status = served.session.status()
        client.kill()
        client.wait()
    return {**status, "peak_memory_kb": [before, after]}


def real_time_loop(machine: Hoist) -> dict[str, float]:
    """The metrics of the loop at 250 Hz over UDP against the clock; the plant, in a process of its own, at 1 kHz with a
    state every fourth step."""
    with tempfile.TemporaryDirectory() as folder:
        save_machine(machine, Path(folder) / "machine.yaml")
        options = ["--port", "0", "--send-every", "4", "--priority"]
        options += ["--payload", str(PAYLOAD_KG), "--start-position", str(START_M)]
        words = [sys.executable, "-m", "workbench", "serve", f"{folder}/machine.yaml", *options]
        server = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        assert server.stderr is not None
        try:
            said = next(line for line in server.stderr if ", port " in line)
            client = Client(int(said.partition(", port ")[2].partition(",")[0]))
            ask_priority()
            return closed_loop(client, case_at(250.0, machine), every=4)
        finally:
            server.terminate()
            server.wait()


def main(say: Callable[[str], None] = print) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    seconds = parser.parse_args().seconds
    machine = default_hoist()
    (study,) = simulate_loop([case_at(250.0, machine)], record_every=0)
    far = off_percent(real_time_loop(machine), study.metrics)
    beyond = {name: round(percent, 3) for name, percent in far.items() if percent > 1.0}
    say(
        f"closed loop at 250 Hz against the clock: {len(far) - len(beyond)} of {len(far)} metrics within 1 % of the "
        f"study; beyond, in per cent: {beyond or 'none'}"
    )
    status = on_time(machine, seconds)
    say(json.dumps({key: status[key] for key in ("counts", "pace", "peak_memory_kb")}, indent=1))


if __name__ == "__main__":
    main()
