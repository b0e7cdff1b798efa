"""A plant of this session: `workbench.serve` in a process of its own, which ends with the session.

    plant = PlantProcess(machine, Wish(...))            # or a UDP port of this computer in place of the wish
    plant.ask("order", {"set": {"payload_kg": 9000}}, "payload")

What is asked for is a method of `Recorder`, called in the plant's process. An order is one of `Session.order`.
"""

from __future__ import annotations

import json
import math
import multiprocessing
import socket
import subprocess
import sys
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import repeat
from multiprocessing.connection import Connection
from types import SimpleNamespace
from typing import Any

import numpy as np

from workbench.control import PiSettings, full_pi, loop_values
from workbench.control.settings import refuse
from workbench.core.errors import InputError
from workbench.dashboard.jobs import child_environment
from workbench.engine.stepped import Step as ControllerStep
from workbench.machines import HOIST, Hoist, load_of
from workbench.references import Limits, Step, motor_speed_rad_s, plan_motion
from workbench.serve.serve import Wish, serve
from workbench.serve.session import FLAGS, TORQUE, Session
from workbench.serve.udp import MOST_BYTES
from workbench.simulate.loop import LoopCase, case_limits

MOST_IN_ALL = 8  # plants of all sessions
EVERY_S, KEPT_S = 0.04, 60.0  # between two rows of a plant's numbers; how much of them is kept
ANSWERS_WITHIN_S, PLANT_ANSWERS_WITHIN_S = 5.0, 1.0
SWITCH_S = 0.0005  # how long one thread may keep the others waiting
MOST_SAID = MOST_EVENTS = 100
FASTEST_S = 0.004  # of the client's sampling: a thread of an ordinary system is no quicker with certainty
LEAST_MOVE_M, PAUSE_S = 0.01, 1.5  # of the built-in client; the pause at either end of the way
SIGNALS = tuple(signal.name for signal in HOIST.plant.signals)
READ = ("time_s", TORQUE, "torque_at_work_nm", *SIGNALS, "payload_now_kg", *(f"is_{name}" for name, _ in FLAGS))
# Flags whose beginning is an event, in words.
BEGINS = {
    "is_watchdog": "watchdog", "is_slack": "slack wire", "is_off_rail": "off the rail", "is_diverged": "diverged",
    "is_overload": "wire overloaded",
}  # fmt: skip
BUILT_IN = "the built-in client"
Numbers = Mapping[str, float]
Order = Callable[[Mapping[str, Any]], dict[str, Any]]  # to a plant; InputError for what it refuses, or where none is

_running: weakref.WeakSet[PlantProcess] = weakref.WeakSet()


# ---- in the page's process ----------------------------------------------------------------------------------------


class PlantProcess:
    """Started at once; `greeting()` is None until the plant is there, for its step may have to be compiled.

    what: how to serve the machine, or a port of this computer at which it is served. InputError when too many run.
    """

    def __init__(self, machine: Hoist, what: Wish | int) -> None:
        if sum(plant.alive for plant in _running) >= MOST_IN_ALL:
            raise InputError("this computer already serves the plants of others; try again in a while")
        self.machine, self.what = machine, what
        self._line, other_end = multiprocessing.Pipe()
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "workbench.dashboard.plant", str(other_end.fileno())],
            pass_fds=[other_end.fileno()], env=child_environment(), start_new_session=True,
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        other_end.close()
        self._one_at_a_time = threading.Lock()
        self._greeting: dict[str, Any] | None = None
        self.end = weakref.finalize(self, _ended, self._process, self._line)
        _running.add(self)
        self._line.send((machine, what))

    @property
    def alive(self) -> bool:
        return self._process.poll() is None

    def greeting(self, within_s: float = 0.0) -> dict[str, Any] | None:
        """Port, the machine's name, names of the points; None until it is there. InputError where it failed."""
        with self._one_at_a_time:
            self._greeting = self._greeting or self._read(within_s)
            return self._greeting

    def ask(self, method: str, *arguments: Any) -> Any:
        """What the method of `Recorder` answers. InputError for what is refused, and for a plant that has gone."""
        if self.greeting() is None:
            raise InputError("the plant is not there yet")
        with self._one_at_a_time:
            with suppress(OSError):  # one that has gone is said below
                self._line.send((method, arguments))
            answer = self._read(ANSWERS_WITHIN_S)
        if answer is None:
            self.end()  # an answer that comes late would be taken for another question's
            raise InputError("the plant does not answer any more; start it again")
        return answer

    def _read(self, within_s: float) -> Any:
        """None where no answer comes in time. InputError where it is one."""
        try:
            if not self._line.poll(within_s):
                return None
            error, answer = self._line.recv()
        except (OSError, EOFError) as gone:
            raise InputError("the plant has ended; start it again") from gone
        if error is not None:
            raise InputError(error[0], place=error[1])
        return answer


def _ended(process: subprocess.Popen[bytes], line: Connection[Any, Any]) -> None:
    """Its sockets and files are the system's to close."""
    process.kill()
    line.close()
    process.wait()


# ---- in the plant's process ---------------------------------------------------------------------------------------


def udp_order(port: int) -> Order:
    """Orders to a plant that another process of this computer serves over UDP, from one address: it knows its
    controller by that."""
    line, one_at_a_time = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), threading.Lock()
    line.connect(("127.0.0.1", port))

    def order(question: Mapping[str, Any]) -> dict[str, Any]:
        with one_at_a_time:
            ends = time.monotonic() + PLANT_ANSWERS_WITHIN_S
            try:
                line.send(json.dumps(question).encode())
                data = b""
                while not data.startswith(b"{"):  # states come, too
                    line.settimeout(max(ends - time.monotonic(), 0.0))
                    data = line.recv(MOST_BYTES)
                answer: dict[str, Any] = json.loads(data)
            except (OSError, ValueError) as error:
                said = f"no plant answers over UDP on port {port} of this computer"
                raise InputError(f"{said}; start one with `workbench serve`", place="port") from error
        if "error" in answer:
            raise InputError(str(answer["error"]))
        return answer

    return order


@dataclass(frozen=True)
class Wanted:
    """What the built-in client does: hold where it is, or go up and down between two heights under limits."""

    settings: PiSettings
    heights_m: tuple[float, float] | None = None
    reference: str = "ruckig"
    limits: Limits | None = None


class Controller(threading.Thread):
    """The built-in client: the studies' sampled PI on what is seen of a plant. It begins anew where the brake holds and
    where time went back. Started, it closes the loop by orders until `stop()`; ended: why it did by itself."""

    def __init__(self, machine: Hoist, wanted: Wanted, order: Order | None = None) -> None:
        super().__init__(name="client", daemon=True)
        self.machine, self.wanted, self.order = machine, wanted, order
        self.dt = max(wanted.settings.sample_time_s, FASTEST_S)
        self.settings = wanted.settings.model_copy(update={"sample_time_s": self.dt})
        self.reference_rad_s, self.ended = 0.0, ""
        self._pi: ControllerStep | None = None
        self._upwards, self._height_m, self._last_s, self._n = True, 0.0, 0.0, 0
        self._end = threading.Event()

    def torque_nm(self, seen: Numbers, payload_kg: float) -> float:
        """The command at one sample, of all motors. seen: `READ`."""
        # What holds the wire's tension at the drum.
        hold = seen["tension_drum_n"] * 0.5 * self.machine.winch.drum_diameter_m / self.machine.gearbox.ratio
        braked, self._height_m = seen["is_brake_closed"] > 0.0, seen["position_carriage_m"]
        if self._pi is None or braked or seen["time_s"] < self._last_s:
            self._pi, self._n, self._way = self._begun(seen, hold, payload_kg), 0, self._speeds()
        self._last_s = seen["time_s"]
        self.reference_rad_s = 0.0 if braked else next(self._way)
        if braked:
            return hold
        self._n += 1
        return self._pi(self.reference_rad_s, self._n * self.dt, seen["speed_motor_rad_s"], seen["angle_motor_rad"])

    def _begun(self, seen: Numbers, hold: float, payload_kg: float) -> ControllerStep:
        machine = self.machine
        refuse(self.settings, "the built-in client runs", "load_damping", "input_shaper")
        controller = full_pi(machine.drive.speed_delay_s > 0.0, *self.settings.parts)
        own = loop_values(self.settings, machine.drive, hold, payload_kg)
        # Angles taken at the uneven instants of an ordinary clock are no encoder: the speed is read instead.
        numbers = {**vars(HOIST.plant.values(machine, payload_kg)), **own, "counts": 0.0}
        case = LoopCase("served", machine, payload_kg, self._height_m, self.settings, np.zeros(1))
        p = SimpleNamespace(**numbers, **case_limits(case))
        return ControllerStep(controller, p, controller.start(p, hold, seen["angle_motor_rad"]), self.dt)

    def _speeds(self) -> Iterator[float]:
        """A speed of the motor for each sample, rad/s: to one end of the way, a pause, to the other."""
        machine, wanted = self.machine, self.wanted
        rail = (machine.rail.lowest_position_m, machine.highest_position_m)
        while wanted.heights_m is not None and wanted.limits is not None:
            by = wanted.heights_m[1 if self._upwards else 0] - self._height_m
            self._upwards = not self._upwards
            if abs(by) < LEAST_MOVE_M:
                yield from [0.0] * round(PAUSE_S / self.dt)
                continue
            plan = plan_motion(
                wanted.reference, [Step(by_m=by)], self._height_m, wanted.limits, rail, settle_s=PAUSE_S,
                load=load_of(machine, 0.0),
            )  # fmt: skip
            speed = plan.sample(self.dt, plan.duration_s).speed_m_s
            yield from motor_speed_rad_s(speed, machine.gearbox.ratio, machine.winch.drum_diameter_m).tolist()
        yield from repeat(0.0)

    def run(self) -> None:
        assert self.order is not None
        try:
            seen = self.order({"get": list(READ)})["get"]
            payload, due = seen["payload_now_kg"], time.monotonic()
            while not self._end.wait(max(due - time.monotonic(), 0.0)):
                late = time.monotonic() - due
                due = due + self.dt if late < 0.5 else time.monotonic() + self.dt
                torque = self.torque_nm(seen, payload)
                seen = self.order({"set": {TORQUE: torque}, "get": list(READ)})["get"]
        except InputError as error:
            self.ended = str(error)
        self.reference_rad_s = math.nan

    def stop(self, why: str = "") -> None:
        self.ended = why
        self._end.set()
        self.join(2.0)


class Recorder:
    """What a page may ask of a plant: orders, a built-in client, and what the plant did lately, taken in a thread.

    A plant whose time stands adds no rows; one that was reset begins anew. control: orders of the built-in client,
    which yields to any other client.
    """

    def __init__(self, order: Order, machine: Hoist, said: deque[str], control: Order | None = None) -> None:
        self._order, self._control, self.machine, self.said = order, control or order, machine, said
        self.client: Controller | None = None
        self.problem, self.status = "", dict[str, Any]()
        self._lock = threading.Lock()
        self._now: dict[str, float] = {}
        self._rows: deque[list[float]] = deque(maxlen=round(KEPT_S / EVERY_S))
        self._events: deque[tuple[float, str]] = deque(maxlen=MOST_EVENTS)

    def record(self) -> None:
        """Until the process ends."""
        while True:
            time.sleep(EVERY_S)
            try:
                self.take()
                self.problem = ""
            except InputError as error:
                self.problem = str(error)

    def take(self) -> None:
        """One row of `READ` and the client's reference; the status."""
        answer, client, before_status = self._order({"get": list(READ), "status": True}), self.client, self.status
        self.status = answer["status"]
        refused = [status.get("counts", {}).get("refused_second_client", 0) for status in (before_status, self.status)]
        if client is not None and client.is_alive() and refused[1] > refused[0]:
            client.stop("another client commands this plant; the built-in one has let go")
        now = {**answer["get"], "speed_reference_rad_s": math.nan if client is None else client.reference_rad_s}
        with self._lock:
            before, self._now = self._now, now
            if before and now["time_s"] < before["time_s"]:
                self._rows.clear()
                self._events.clear()
            begun = [words for name, words in BEGINS.items() if now[name] > before.get(name, 0.0)]
            self._events.extend((now["time_s"], words) for words in begun)
            if not before or now["time_s"] != before["time_s"]:
                self._rows.append(list(now.values()))

    def order(self, question: Mapping[str, Any], note: str = "") -> dict[str, Any]:
        """The plant's answer. note: words of the order for the events."""
        answer = self._order(question)
        if note:
            with self._lock:
                self._events.append((self._now.get("time_s", 0.0), note))
        return answer

    def use(self, wanted: Wanted | None) -> bool:
        """A built-in client that does this in place of the one before; None for none."""
        if self.client is not None:
            self.client.stop()
        self.client = None if wanted is None else Controller(self.machine, wanted, self._control)
        if self.client is not None:
            self.client.start()
        return True

    def seen(self) -> dict[str, Any]:
        """The last minute: `columns` name -> (n,), events, and how things stand now."""
        client = self.client
        with self._lock:
            table = np.array(self._rows, dtype=float).reshape(len(self._rows), len(self._now))
            return {
                "columns": {name: table[:, i] for i, name in enumerate(self._now)}, "now": dict(self._now),
                "events": list(self._events), "problem": self.problem, "status": self.status, "said": list(self.said),
                "client_at_work": bool(client and client.is_alive()), "client_ended": client.ended if client else "",
            }  # fmt: skip


def main(line: Connection[Any, Any]) -> None:
    """Serves or attaches, and answers until nobody asks any more."""
    sys.setswitchinterval(SWITCH_S)
    machine, what = line.recv()
    stop, said = threading.Event(), deque[str](maxlen=MOST_SAID)

    def refused(error: InputError) -> None:
        line.send(((error.problem, error.place), None))

    def answers(recorder: Recorder, greeting: Mapping[str, Any]) -> None:
        line.send((None, greeting))
        threading.Thread(target=recorder.record, name="recorder", daemon=True).start()
        with suppress(EOFError, OSError):  # the page's end has gone
            while True:
                method, arguments = line.recv()
                try:
                    line.send((None, getattr(recorder, method)(*arguments)))
                except InputError as error:
                    refused(error)
        stop.set()

    def ready(session: Session, port: int) -> None:
        recorder = Recorder(session.order, machine, said, lambda order: session.order(order, BUILT_IN))
        greeting = {"port": port, "name": machine.name, **session.order({"points": True})}
        threading.Thread(target=answers, args=(recorder, greeting), name="answers", daemon=True).start()

    try:
        if isinstance(what, Wish):
            serve(machine, what, said.append, stop, ready=ready)
        else:
            order = udp_order(what)
            there = order({"status": True, "points": True})
            greeting = {"port": what, "name": there["status"]["machine"], "points": there["points"]}
            answers(Recorder(order, machine, said), greeting)
    except InputError as error:
        refused(error)


if __name__ == "__main__":
    main(Connection(int(sys.argv[1])))
