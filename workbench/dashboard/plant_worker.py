"""The process of a session's plant: `python -m workbench.dashboard.plant_worker`. It ends when its standard input does.

The first line in is what to serve or to attach to; then a line of JSON for every question, and one for its answer. What
is known of a plant at one instant is a mapping of the names in `READ` to numbers.
"""

from __future__ import annotations

import json
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np
from pydantic import TypeAdapter

from workbench.control import PiSettings, full_pi, loop_values
from workbench.core.errors import InputError
from workbench.core.yaml_strict import loads
from workbench.dashboard.plant import EVERY_S, KEPT_S
from workbench.effects import check
from workbench.engine.stepped import Step as ControllerStep
from workbench.machines import HOIST, Hoist, load_of, studied
from workbench.machines.files import machine_from
from workbench.references import Limits, Step, motor_speed_rad_s, plan_motion
from workbench.serve.points import BRAKE, FLAGS, TORQUE
from workbench.serve.serve import Wish, serve
from workbench.serve.session import Session
from workbench.serve.udp import BRAKE_BIT, MOST_BYTES, command_packet, state_in
from workbench.simulate.loop import LoopCase, case_limits

HERE = "127.0.0.1"  # a page reaches plants of this computer only
ANSWERS_WITHIN_S = 1.0
SWITCH_S = 0.0005  # how long one thread may keep the others waiting
MOST_SAID = MOST_EVENTS = 100
FASTEST_S = 0.004  # of the controller's sampling: a thread of an ordinary system is no quicker with certainty
LEAST_MOVE_M, PAUSE_S = 0.01, 1.5  # of the built-in client; the pause at either end of the way
SIGNALS = tuple(signal.name for signal in HOIST.plant.signals)
SWITCHES = tuple(f"is_{name}" for name, _ in FLAGS)
READ = ("time_s", TORQUE, "torque_at_work_nm", *SIGNALS, "payload_now_kg", *SWITCHES)
# Flags whose beginning is an event, in words.
BEGINS = {
    "is_watchdog": "watchdog", "is_slack": "slack wire", "is_off_rail": "off the rail", "is_diverged": "diverged",
}  # fmt: skip
Numbers = Mapping[str, float]


class OtherClientError(Exception):
    """Somebody else commands this plant."""


def numbers_of(time_s: float, torque_nm: float, signals: Numbers, flags: int) -> dict[str, float]:
    switches = {name: float(flags >> bit & 1) for bit, name in enumerate(SWITCHES)}
    return {"time_s": time_s, "torque_at_work_nm": torque_nm, **signals, **switches}


class Line(Protocol):
    """One end of a line to a plant."""

    def order(self, order: dict[str, Any]) -> dict[str, Any]:
        """As `Session.order`. InputError for what it refuses, and for a plant that does not answer."""
        ...

    def seen(self) -> Numbers | None:
        """The latest state, for a client; None before there is one."""
        ...

    def numbers(self) -> Numbers:
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

    def seen(self) -> Numbers:
        with self._session.lock:
            plant = self._session.plant
            return numbers_of(plant.time_s, plant.at_work, dict(plant.signals), self._session.flags)

    def numbers(self) -> Numbers:
        with self._session.lock:  # held shortly: the next step waits for it
            seen, asked, payload = self.seen(), self._session.asked, self._session.plant.value("m_p")
        return {**seen, TORQUE: asked, "payload_now_kg": payload}

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
        self._line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)  # one: the plant knows its controller by it
        self._line.connect((HERE, port))
        self._port, self._sequence = port, 0
        self._one_at_a_time = threading.Lock()
        self._seen: Numbers | None = None
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
            self._seen = numbers_of(state.time_s, state.at_work, state.signals, state.flags)
        return data

    def seen(self) -> Numbers | None:
        if self._one_at_a_time.acquire(blocking=False):  # an order that waits for its answer reads the states too
            try:
                while True:
                    self._receive(0.0)
            except OSError:
                pass
            finally:
                self._one_at_a_time.release()
        return self._seen

    def numbers(self) -> Numbers:
        read: Numbers = self.order({"get": list(READ)})["get"]
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
        """The command at one sample, of all motors."""
        # What holds the wire's tension at the drum.
        hold = seen["tension_drum_n"] * 0.5 * self.machine.winch.drum_diameter_m / self.machine.gearbox.ratio
        braked = seen["is_brake_closed"] > 0.0
        if braked or seen["time_s"] < self._last_s:
            self._pi = None
        self._last_s = seen["time_s"]
        if self._pi is None:
            self._pi, self._n, self._way = self._begun(seen, hold, payload_kg), 0, iter(())
        if braked:
            self.reference_rad_s = 0.0
            return hold
        self.reference_rad_s = 0.0 if self.wanted.heights_m is None else self._next(seen["position_carriage_m"])
        self._n += 1
        return self._pi(self.reference_rad_s, self._n * self.dt, seen["speed_motor_rad_s"], seen["angle_motor_rad"])

    def _begun(self, seen: Numbers, hold: float, payload_kg: float) -> ControllerStep:
        machine = self.machine
        controller = full_pi(machine.drive.speed_delay_s > 0.0, self.settings.feed_forward.through_the_wire)
        numbers = {**vars(HOIST.plant.values(machine, payload_kg)), **loop_values(self.settings, machine.drive, hold)}
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
    """A controller at work on a line, in a thread of its own until `stop()`. ended: why it ended by itself."""

    def __init__(self, line: Line, machine: Hoist, wanted: Wanted) -> None:
        self.controller, self._line = Controller(machine, wanted), line
        self.ended = ""
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="client", daemon=True)
        self._thread.start()

    @property
    def at_work(self) -> bool:
        return self._thread.is_alive()

    def stop(self) -> None:
        self._stop.set()
        self._thread.join(2.0)

    def _run(self) -> None:
        try:
            self._work()
        except OtherClientError:
            self.ended = "another client commands this plant; the built-in one has let go"
        except InputError as error:
            self.ended = str(error)

    def _work(self) -> None:
        line, controller = self._line, self.controller
        line.release()
        first = line.order({"get": [TORQUE, "payload_kg"]})["get"]
        payload, hold, due = float(first["payload_kg"]), float(first[TORQUE]), time.monotonic()
        while not self._stop.wait(max(due - time.monotonic(), 0.0)):
            late = time.monotonic() - due
            due = due + controller.dt if late < 0.5 else time.monotonic() + controller.dt
            seen = line.seen()
            line.command(hold if seen is None else controller.torque_nm(seen, payload))


class Recorder:
    """What a plant did lately: its numbers at an even rate, and events, taken in a thread from `start()` to `stop()`.

    Rows have a running number, so that a page asks for those that it has not seen. A plant whose time stands adds no
    rows; one that was reset begins anew.
    """

    def __init__(self, line: Line) -> None:
        self._line = line
        self._lock = threading.Lock()
        self._rows: deque[list[float]] = deque(maxlen=round(KEPT_S / EVERY_S))
        self._count = self._generation = 0
        self._columns: list[str] = []
        self._now: dict[str, float] = {}
        self._events: deque[tuple[float, str]] = deque(maxlen=MOST_EVENTS)
        self.problem = ""
        self.client: Client | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._stop.set()
        self._thread.join(2.0)

    def note(self, words: str) -> None:
        """An event of now."""
        with self._lock:
            self._events.append((self._now.get("time_s", 0.0), words))

    def since(self, generation: int, number: int) -> dict[str, Any]:
        """For JSON: the rows from `number` on, or all of them where the plant was reset since `generation`."""
        with self._lock:
            first = self._count - len(self._rows)
            skip = max(0, number - first) if generation == self._generation else 0
            return {
                "generation": self._generation, "next": self._count, "columns": self._columns,
                "rows": list(self._rows)[skip:], "now": self._now, "events": list(self._events),
                "problem": self.problem,
            }  # fmt: skip

    def _run(self) -> None:
        while not self._stop.wait(EVERY_S):
            try:
                self.take(self._line.numbers())
                self.problem = ""
            except InputError as error:
                self.problem = str(error)

    def take(self, read: Numbers) -> None:
        """One row, from what `Line.numbers` says and the client's reference."""
        client = self.client
        reference = client.controller.reference_rad_s if client is not None and client.at_work else float("nan")
        now = {**read, "speed_reference_rad_s": reference}
        with self._lock:
            before, self._now = self._now, now
            if before and now["time_s"] < before["time_s"]:
                self._rows.clear()
                self._events.clear()
                self._generation, self._count = self._generation + 1, 0
            begun = [words for name, words in BEGINS.items() if now[name] > before.get(name, 0.0)]
            self._events.extend((now["time_s"], words) for words in begun)
            if not before or now["time_s"] != before["time_s"]:
                self._columns = list(now)
                self._rows.append([round(value, 6) for value in now.values()])
                self._count += 1


class Desk:
    """The plant's line, its recorder and the built-in client, and what a page may ask of them."""

    def __init__(self, line: Line, machine: Hoist, said: deque[str]) -> None:
        self.line, self.machine, self.said = line, machine, said
        self.recorder = Recorder(line)
        self.recorder.start()

    def answer(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """`order`: to the plant; `note`: words of it for the events; `client`: null ends it; `rows`: [generation,
        number]."""
        answer: dict[str, Any] = {}
        if "order" in question:
            answer["order"] = self.line.order(question["order"])
            if question.get("note"):
                self.recorder.note(str(question["note"]))
        if "client" in question:
            if self.recorder.client is not None:
                self.recorder.client.stop()
            wanted = question["client"]
            self.recorder.client = None if wanted is None else Client(self.line, self.machine, wanted_of(wanted))
        if "rows" in question:
            generation, number = question["rows"]
            client = self.recorder.client
            answer |= self.recorder.since(int(generation), int(number))
            answer["status"] = self.line.order({"status": True})["status"]
            answer["client"] = {
                "at_work": client is not None and client.at_work, "ended": "" if client is None else client.ended,
            }  # fmt: skip
            answer["said"] = list(self.said)
        return answer


def wanted_of(given: Mapping[str, Any]) -> Wanted:
    """What the client does, from JSON: settings; heights_m, reference and limits where it moves."""
    settings = PiSettings.model_validate(given["settings"])
    if given.get("heights_m") is None:
        return Wanted(settings)
    low, high = given["heights_m"]
    return Wanted(settings, (float(low), float(high)), str(given["reference"]), Limits(*given["limits"]))


def wish_of(given: Mapping[str, Any]) -> Wish:
    """InputError for what cannot be."""
    wish = TypeAdapter(Wish).validate_python({**given, "ready": tuple(given.get("ready", ()))})
    wish.check()
    return wish


def main() -> int:
    sys.setswitchinterval(SWITCH_S)
    spec = json.loads(sys.stdin.readline())
    stop, said = threading.Event(), deque[str](maxlen=MOST_SAID)
    try:
        machine = machine_from(loads(spec["machine"], "machine.yaml"), check_effects=check)
        hoist = studied(machine)
        if "attach" in spec:
            assert hoist is not None
            line = UdpLine(int(spec["attach"]))
            status = line.order({"status": True, "points": True})
            _say({"port": int(spec["attach"]), "name": status["status"]["machine"], "points": status["points"]})
            _answer_all(Desk(line, hoist, said), stop)
            return 0

        def ready(session: Session, port: int) -> None:
            assert hoist is not None
            points = [point.name for point in (*session.inputs, *session.outputs)]
            _say({"port": port, "name": hoist.name, "points": points})
            desk = Desk(OwnLine(session), hoist, said)
            threading.Thread(target=_answer_all, args=(desk, stop), name="answers", daemon=True).start()

        serve(machine, wish_of(spec["wish"]), said.append, stop, ready=ready)
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
