"""A plant of this session, as a thin client of `workbench.serve`, in a process of its own that ends with the session.

    process = PlantProcess({"machine": text, "wish": {...}})      # or "attach": a port of this computer
    process.ask({"order": {"set": {"payload_kg": 9000}}, "note": "payload"})

`python -m workbench.dashboard.plant` is that process: the first line in is what to serve or to attach to; then a
line of JSON for every question, and one for its answer. Whatever is asked of a plant is an order of `Session.order`.
"""

from __future__ import annotations

import json
import os
import select
import socket
import subprocess
import sys
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from workbench.control import PiSettings, full_pi, loop_values, refuse
from workbench.core.errors import InputError
from workbench.core.yaml_strict import loads
from workbench.effects import check
from workbench.engine.stepped import Step as ControllerStep
from workbench.machines import HOIST, Hoist, load_of, machine_from, studied
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
Numbers = Mapping[str, float]
Order = Callable[[Mapping[str, Any]], dict[str, Any]]  # to a plant; InputError for what it refuses, or where none is

_running: weakref.WeakSet[PlantProcess] = weakref.WeakSet()


# ---- in the page's process ----------------------------------------------------------------------------------------


class PlantProcess:
    """Started at once; `greeting()` is None until the plant is there, for its step may have to be compiled.

    spec: `machine` (YAML) with either `wish`, the fields of `serve.Wish`, or `attach`, a port of this computer.
    InputError when too many are running.
    """

    def __init__(self, spec: Mapping[str, Any]) -> None:
        from workbench.dashboard.jobs import child_environment

        if sum(plant.alive for plant in _running) >= MOST_IN_ALL:
            raise InputError("this computer already serves the plants of others; try again in a while")
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "workbench.dashboard.plant"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, env=child_environment(), start_new_session=True, bufsize=0,
        )  # fmt: skip
        self._rest = b""
        self._one_at_a_time = threading.Lock()
        self._greeting: dict[str, Any] | None = None
        self._end = weakref.finalize(self, _ended, self._process)
        _running.add(self)
        self._write(spec)

    @property
    def alive(self) -> bool:
        return self._process.poll() is None

    def greeting(self, within_s: float = 0.0) -> dict[str, Any] | None:
        """Port, the machine's name, names of the points; None until it is there. InputError where it failed."""
        with self._one_at_a_time:
            self._greeting = self._greeting or self._read(within_s)
            if self._greeting is None and not self.alive:
                raise InputError("the plant's process ended without a word")
            return self._greeting

    def ask(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """See `Desk.answer`. InputError for what is refused, and for a plant that has gone."""
        if self.greeting() is None:
            raise InputError("the plant is not there yet")
        with self._one_at_a_time:
            self._write(question)
            answer = self._read(ANSWERS_WITHIN_S)
        if answer is None:
            self.end()  # an answer that comes late would be taken for another question's
            raise InputError("the plant does not answer any more; start it again")
        return answer

    def end(self) -> None:
        self._end()

    def _write(self, words: Mapping[str, Any]) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(words).encode() + b"\n")
        except (OSError, ValueError) as error:
            raise InputError("the plant has ended; start it again") from error

    def _read(self, within_s: float) -> dict[str, Any] | None:
        """One line; None where none comes in time. InputError where it is one."""
        out = self._process.stdout
        assert out is not None
        while b"\n" not in self._rest:
            if not select.select([out], [], [], within_s)[0] or not (part := os.read(out.fileno(), 1 << 20)):
                return None
            self._rest += part
        line, _, self._rest = self._rest.partition(b"\n")
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            raise InputError(answer["error"]["problem"], place=answer["error"]["place"])
        return answer


def _ended(process: subprocess.Popen[bytes]) -> None:
    """Its sockets and files are the system's to close."""
    process.kill()
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            stream.close()
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


class Controller:
    """The studies' sampled PI on what is seen of a plant. It begins anew where the brake holds and where time went
    back."""

    def __init__(self, machine: Hoist, wanted: Wanted) -> None:
        self.machine, self.wanted = machine, wanted
        self.dt = max(wanted.settings.sample_time_s, FASTEST_S)
        self.settings = wanted.settings.model_copy(update={"sample_time_s": self.dt})
        self.reference_rad_s = 0.0
        self._pi: ControllerStep | None = None
        self._way: Iterator[float] = iter(())
        self._upwards = True
        self._last_s = 0.0
        self._n = 0

    def torque_nm(self, seen: Numbers, payload_kg: float) -> float:
        """The command at one sample, of all motors. seen: `READ`."""
        # What holds the wire's tension at the drum.
        hold = seen["tension_drum_n"] * 0.5 * self.machine.winch.drum_diameter_m / self.machine.gearbox.ratio
        braked = seen["is_brake_closed"] > 0.0
        if self._pi is None or braked or seen["time_s"] < self._last_s:
            self._pi, self._n, self._way = self._begun(seen, hold, payload_kg), 0, iter(())
        self._last_s = seen["time_s"]
        self.reference_rad_s = 0.0
        if braked:
            return hold
        if self.wanted.heights_m is not None:
            self.reference_rad_s = self._next(seen["position_carriage_m"])
        self._n += 1
        return self._pi(self.reference_rad_s, self._n * self.dt, seen["speed_motor_rad_s"], seen["angle_motor_rad"])

    def _begun(self, seen: Numbers, hold: float, payload_kg: float) -> ControllerStep:
        machine = self.machine
        refuse(self.settings, "the built-in client runs", "load_damping", "input_shaper")
        controller = full_pi(machine.drive.speed_delay_s > 0.0, *self.settings.parts)
        own = loop_values(self.settings, machine.drive, hold, payload_kg)
        numbers = {**vars(HOIST.plant.values(machine, payload_kg)), **own}
        # Angles taken at the uneven instants of an ordinary clock are no encoder: the speed is read instead.
        numbers["counts"] = 0.0
        case = LoopCase("served", machine, payload_kg, seen["position_carriage_m"], self.settings, np.zeros(1))
        p = SimpleNamespace(**numbers, **case_limits(case))
        return ControllerStep(controller, p, controller.start(p, hold, seen["angle_motor_rad"]), self.dt)

    def _next(self, height_m: float) -> float:
        """The reference's motor speed at this sample, rad/s."""
        value = next(self._way, None)
        if value is None:
            self._way = self._stroke(height_m)
            value = next(self._way, 0.0)
        return value

    def _stroke(self, height_m: float) -> Iterator[float]:
        """From here to the other end of the way, then a pause: a speed of the motor for each sample."""
        machine, wanted = self.machine, self.wanted
        assert wanted.heights_m is not None and wanted.limits is not None
        by = wanted.heights_m[1 if self._upwards else 0] - height_m
        self._upwards = not self._upwards
        if abs(by) < LEAST_MOVE_M:
            return iter([0.0] * round(PAUSE_S / self.dt))
        rail = (machine.rail.lowest_position_m, machine.highest_position_m)
        plan = plan_motion(
            wanted.reference, [Step(by_m=by)], height_m, wanted.limits, rail, settle_s=PAUSE_S,
            load=load_of(machine, 0.0),
        )  # fmt: skip
        motion = plan.sample(self.dt, plan.duration_s)
        speed = motor_speed_rad_s(motion.speed_m_s, machine.gearbox.ratio, machine.winch.drum_diameter_m)
        return iter(speed.tolist())


class Client:
    """A controller at work in a thread of its own until `stop()`. ended: why it ended by itself."""

    def __init__(self, order: Order, machine: Hoist, wanted: Wanted) -> None:
        self.controller, self.order = Controller(machine, wanted), order
        self.ended = ""
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="client", daemon=True)
        self._thread.start()

    @property
    def at_work(self) -> bool:
        return self._thread.is_alive()

    def stop(self, why: str = "") -> None:
        self.ended = why
        self._stop.set()
        self._thread.join(2.0)

    def _run(self) -> None:
        try:
            seen = self.order({"get": list(READ)})["get"]
            payload, due = seen["payload_now_kg"], time.monotonic()
            while not self._stop.wait(max(due - time.monotonic(), 0.0)):
                late = time.monotonic() - due
                due = due + self.controller.dt if late < 0.5 else time.monotonic() + self.controller.dt
                torque = self.controller.torque_nm(seen, payload)
                seen = self.order({"set": {TORQUE: torque}, "get": list(READ)})["get"]
        except InputError as error:
            self.ended = str(error)


class Desk:
    """What a page may ask of a plant: orders, a built-in client, and what the plant did lately, taken in a thread.

    Rows have a running number, so that a page asks for those that it has not seen. A plant whose time stands adds no
    rows; one that was reset begins anew. control: orders of the built-in client, which yields to any other client.
    """

    def __init__(self, order: Order, machine: Hoist, said: deque[str], control: Order | None = None) -> None:
        self.order, self.control, self.machine, self.said = order, control or order, machine, said
        self.client: Client | None = None
        self.problem = ""
        self.status: dict[str, Any] = {}
        self._lock = threading.Lock()
        self._rows: deque[list[float]] = deque(maxlen=round(KEPT_S / EVERY_S))
        self._count = self._generation = 0
        self._now: dict[str, float] = {}
        self._events: deque[tuple[float, str]] = deque(maxlen=MOST_EVENTS)

    def record(self) -> None:
        """Until the process ends."""
        while True:
            time.sleep(EVERY_S)
            try:
                self.take(self.order({"get": list(READ), "status": True}))
                self.problem = ""
            except InputError as error:
                self.problem = str(error)

    def take(self, answer: Mapping[str, Any]) -> None:
        """One row, from the answer to an order for `READ` and the status, and the client's reference."""
        client, read, before_status = self.client, answer["get"], self.status
        self.status = answer["status"]
        refused = [status.get("counts", {}).get("refused_second_client", 0) for status in (before_status, self.status)]
        if client is not None and client.at_work and refused[1] > refused[0]:
            client.stop("another client commands this plant; the built-in one has let go")
        at_work = client is not None and client.at_work
        now = {
            **read,
            "speed_reference_rad_s": client.controller.reference_rad_s if client and at_work else float("nan"),
        }
        with self._lock:
            before, self._now = self._now, now
            if before and now["time_s"] < before["time_s"]:
                self._rows.clear()
                self._events.clear()
                self._generation, self._count = self._generation + 1, 0
            begun = [words for name, words in BEGINS.items() if now[name] > before.get(name, 0.0)]
            self._events.extend((now["time_s"], words) for words in begun)
            if not before or now["time_s"] != before["time_s"]:
                self._rows.append([round(value, 6) for value in now.values()])
                self._count += 1

    def answer(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """`order`: to the plant; `note`: words of it for the events; `client`: null ends it; `rows`: [generation,
        number], for those from that number on, or all of them where the plant was reset since."""
        answer: dict[str, Any] = {}
        if "order" in question:
            answer["order"] = self.order(question["order"])
            if question.get("note"):
                with self._lock:
                    self._events.append((self._now.get("time_s", 0.0), str(question["note"])))
        if "client" in question:
            if self.client is not None:
                self.client.stop()
            wanted = question["client"]
            self.client = None if wanted is None else Client(self.control, self.machine, wanted_of(wanted))
        if "rows" in question:
            (generation, number), client = question["rows"], self.client
            with self._lock:
                skip = max(0, number - self._count + len(self._rows)) if generation == self._generation else 0
                answer |= {
                    "generation": self._generation, "next": self._count, "columns": list(self._now),
                    "rows": list(self._rows)[skip:], "now": self._now, "events": list(self._events),
                    "problem": self.problem, "status": self.status, "said": list(self.said),
                    "client": {"at_work": bool(client and client.at_work), "ended": client.ended if client else ""},
                }  # fmt: skip
        return answer


def wanted_of(given: Mapping[str, Any]) -> Wanted:
    """What the client does, from JSON: settings; heights_m, reference and limits where it moves."""
    settings = PiSettings.model_validate(given["settings"])
    if given.get("heights_m") is None:
        return Wanted(settings)
    low, high = given["heights_m"]
    return Wanted(settings, (float(low), float(high)), str(given["reference"]), Limits(*given["limits"]))


def main() -> int:
    sys.setswitchinterval(SWITCH_S)
    spec = json.loads(sys.stdin.readline())
    stop, said = threading.Event(), deque[str](maxlen=MOST_SAID)

    def begin(desk: Desk, greeting: Mapping[str, Any]) -> threading.Thread:
        _say(greeting)
        threading.Thread(target=desk.record, name="recorder", daemon=True).start()
        answers = threading.Thread(target=_answer_all, args=(desk, stop), name="answers", daemon=True)
        answers.start()
        return answers

    try:
        hoist = studied(machine_from(loads(spec["machine"], "machine.yaml"), check_effects=check))
        assert hoist is not None
        if "attach" in spec:
            port = int(spec["attach"])
            order = udp_order(port)
            there = order({"status": True, "points": True})
            greeting = {"port": port, "name": there["status"]["machine"], "points": there["points"]}
            begin(Desk(order, hoist, said), greeting).join()
            return 0

        def ready(session: Session, port: int) -> None:
            assert hoist is not None
            greeting = {"port": port, "name": hoist.name, **session.order({"points": True})}
            begin(Desk(session.order, hoist, said, lambda order: session.order(order, "the built-in client")), greeting)

        wish = TypeAdapter(Wish).validate_python({**spec["wish"], "ready": tuple(spec["wish"].get("ready", ()))})
        serve(hoist, wish, said.append, stop, ready=ready)
    except InputError as error:
        _say({"error": {"problem": error.problem, "place": error.place}})
        return 2
    return 0


def _say(words: Mapping[str, Any]) -> None:
    print(json.dumps(words), flush=True)


def _answer_all(desk: Desk, stop: threading.Event) -> None:
    """Until nobody asks any more."""
    try:
        for line in sys.stdin:
            try:
                answer = desk.answer(json.loads(line))
            except InputError as error:
                answer = {"error": {"problem": error.problem, "place": error.place}}
            _say(answer)
    except OSError:
        pass  # the page's end has gone
    stop.set()


if __name__ == "__main__":
    sys.exit(main())
