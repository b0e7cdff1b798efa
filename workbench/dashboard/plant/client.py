"""The built-in client of a served plant: the studies' sampled PI, which holds the load or moves it up and down."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from workbench.control import PiSettings, full_pi, loop_values
from workbench.dashboard.plant.line import Line, OtherClientError, Seen
from workbench.engine.stepped import Step as ControllerStep
from workbench.errors import InputError
from workbench.kinds import load_of
from workbench.machine import Hoist
from workbench.plants import HOIST
from workbench.references import Limits, Step, motor_speed_rad_s, plan_motion
from workbench.simulate.loop import LoopCase, case_limits

FASTEST_S = 0.004  # of the controller's sampling: a thread of an ordinary system is no quicker with certainty
LEAST_MOVE_M = 0.01
PAUSE_S = 1.5  # at either end of the way


@dataclass(frozen=True)
class Wanted:
    """What the client does: hold where it is, or go up and down between two heights under limits."""

    settings: PiSettings
    heights_m: tuple[float, float] | None = None
    reference: str = "ruckig"
    limits: Limits | None = None


class Controller:
    """The sampled PI on what is seen of a plant. It begins anew where the brake holds and where time went back."""

    def __init__(self, machine: Hoist, wanted: Wanted) -> None:
        self.machine, self.wanted = machine, wanted
        self.settings = wanted.settings.model_copy(
            update={"sample_time_s": max(wanted.settings.sample_time_s, FASTEST_S)}
        )
        self.dt = self.settings.sample_time_s
        self.reference_rad_s = 0.0
        self._pi: ControllerStep | None = None
        self._way: Iterator[float] = iter(())
        self._upwards = True
        self._last_s = 0.0
        self._n = 0

    def torque_nm(self, seen: Seen, payload_kg: float) -> float:
        """The command at one sample, of all motors."""
        hold = self._hold_nm(seen)
        if seen.told("brake_closed") or seen.time_s < self._last_s:
            self._pi = None
        self._last_s = seen.time_s
        if self._pi is None:
            self._begin(seen, hold, payload_kg)
        if seen.told("brake_closed"):
            self.reference_rad_s = 0.0
            return hold
        assert self._pi is not None
        self.reference_rad_s = self._next(seen)
        self._n += 1
        speed, angle = seen.signals["speed_motor_rad_s"], seen.signals["angle_motor_rad"]
        return self._pi(self.reference_rad_s, self._n * self.dt, speed, angle)

    def _hold_nm(self, seen: Seen) -> float:
        """What holds the wire's tension at the drum, by all motors."""
        m = self.machine
        return seen.signals["tension_drum_n"] * 0.5 * m.winch.drum_diameter_m / m.gearbox.ratio

    def _begin(self, seen: Seen, hold: float, payload_kg: float) -> None:
        machine, feed_forward = self.machine, self.settings.feed_forward
        controller = full_pi(machine.drive.speed_delay_s > 0.0, feed_forward.through_the_wire)
        numbers = {**vars(HOIST.values(machine, payload_kg)), **loop_values(self.settings, machine.drive, hold)}
        # Angles taken at the uneven instants of an ordinary clock are no encoder: the speed is read instead.
        numbers["counts"] = 0.0
        height = seen.signals["position_carriage_m"]
        case = LoopCase("served", machine, payload_kg, height, self.settings, np.zeros(1))
        p = SimpleNamespace(**numbers, **case_limits(case))
        memory = controller.start(p, hold, seen.signals["angle_motor_rad"])
        self._pi, self._n, self._way = ControllerStep(controller, p, memory, self.dt), 0, iter(())

    def _next(self, seen: Seen) -> float:
        """The reference's motor speed at this sample, rad/s."""
        if self.wanted.heights_m is None:
            return 0.0
        value = next(self._way, None)
        if value is None:
            self._way = self._stroke(seen.signals["position_carriage_m"])
            value = next(self._way, 0.0)
        return value

    def _stroke(self, height_m: float) -> Iterator[float]:
        """From here to the other end of the way, then a pause: a speed of the motor for each sample."""
        assert self.wanted.heights_m is not None and self.wanted.limits is not None
        target = self.wanted.heights_m[1 if self._upwards else 0]
        self._upwards = not self._upwards
        by, rail = target - height_m, (self.machine.rail.lowest_position_m, self.machine.highest_position_m)
        if abs(by) < LEAST_MOVE_M:
            return iter([0.0] * round(PAUSE_S / self.dt))
        load = load_of(self.machine, 0.0)
        plan = plan_motion(
            self.wanted.reference, [Step(by_m=by)], height_m, self.wanted.limits, rail, settle_s=PAUSE_S, load=load
        )
        motion = plan.sample(self.dt, plan.duration_s)
        speed = motor_speed_rad_s(motion.speed_m_s, self.machine.gearbox.ratio, self.machine.winch.drum_diameter_m)
        return iter(speed.tolist())


class Client:
    """A controller at work on a line, in a thread of its own until `stop()`. ended: why it ended by itself."""

    def __init__(self, line: Line, machine: Hoist, wanted: Wanted) -> None:
        self.controller, self._line = Controller(machine, wanted), line
        self.ended = ""
        self.worst_late_s = 0.0
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
        first = line.order({"get": ["torque_motor_nm", "payload_kg"]})["get"]
        payload, hold, dt = float(first["payload_kg"]), float(first["torque_motor_nm"]), controller.dt
        due = time.monotonic()
        while not self._stop.wait(max(due - time.monotonic(), 0.0)):
            late = time.monotonic() - due
            self.worst_late_s = max(self.worst_late_s, late)
            due = due + dt if late < 0.5 else time.monotonic() + dt
            seen = line.seen()
            line.command(hold if seen is None else controller.torque_nm(seen, payload))
