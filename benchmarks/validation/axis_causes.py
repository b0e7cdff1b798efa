"""What can ail an axis: the effects of the campaign format, each with its size drawn, and causes that no list holds."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.validation.axis_machines import Drawn
from benchmarks.validation.kind import TURN, Cause, Numbers, about, drawn_event, either


@dataclass(frozen=True)
class Scales:
    """What is large on one axis; the words of names with a unit for its motion. step_s: of the log.

    level, offset, slope, inertia, gain: what tolerances allow, one standard deviation: of the friction levels, of a
    constant force, of the viscous friction, and of inertia and sensor's gain, relative.
    """

    force: float
    speed: float
    travel: float
    low: float
    ramp_s: float
    step_s: float
    levels: tuple[float, float]
    load: float
    level: float
    offset: float
    slope: float
    inertia: float
    gain: float
    linear: bool

    @property
    def n(self) -> str:
        return "n" if self.linear else "nm"

    @property
    def m(self) -> str:
        return "m" if self.linear else "rad"


def scales_of(axis: Drawn, rate_hz: float) -> Scales:
    machine, role, tol = axis.machine, axis.machine.role, axis.machine.tolerances
    levels = role("coulomb_forward"), role("coulomb_backward")
    level = tol.coulomb * sum(levels) / 2.0 / math.sqrt(2.0)  # the mean of two that are off each by itself
    gain = machine.role("gain_tolerance")
    # What scales the whole equation is taken up by the gain, or by all of its terms together.
    terms = [tol.inertia, tol.coulomb / math.sqrt(2.0), tol.viscous, *([tol.gravity] if axis.loaded else [])]
    return Scales(
        force=axis.force,
        speed=axis.speed,
        travel=axis.travel,
        low=axis.low,
        ramp_s=axis.ramp_s,
        step_s=1.0 / rate_hz,
        levels=levels,
        load=abs(role("gravity_constant")) + 0.5 * abs(role("gravity_sine")),
        level=level,
        offset=math.hypot(machine.offset_tolerance(axis.force), level, tol.gravity * role("gravity_constant")),
        slope=tol.viscous * role("viscous"),
        inertia=math.hypot(tol.inertia, gain),
        gain=math.sqrt(gain**2 + 1.0 / sum(1.0 / term**2 for term in terms)),
        linear=axis.linear,
    )


AxisDraw = Callable[[np.random.Generator, Scales], Cause]


PLAIN = 5.5  # tolerances: an engineer would not put it down to chance
_LEVELS = {True: ("friction_coulomb",), False: ()}  # under a linear axis' constant load a share of it is a level


def caused(
    name: str, regime: str, numbers: Numbers, truth: Numbers | None = None, log: Numbers | None = None,
    alike: tuple[str, ...] = (), subsystem: str = "axis",
) -> Cause:  # fmt: skip
    """A cause whose values are those of the library's entry of its name."""
    return Cause(name, subsystem, regime, numbers, truth or {}, log or {}, library={name: numbers}, alike=alike)


def _viscous(rng: np.random.Generator, s: Scales) -> Cause:
    B = max(s.force / s.speed * about(rng, 0.03, 0.15), PLAIN * s.slope)
    return caused("friction_viscous", "speed", {f"viscous_{s.n}_s_per_{s.m}": B}, {"B_f": B, "B_b": B})


def _viscous_asymmetric(rng: np.random.Generator, s: Scales) -> Cause:
    large = s.force / s.speed * about(rng, 0.04, 0.16)
    small = large * rng.uniform(0.0, 0.45)
    f, b = (large, small) if rng.random() < 0.5 else (small, large)
    unit = f"{s.n}_s_per_{s.m}"
    numbers = {f"viscous_forward_{unit}": f, f"viscous_backward_{unit}": b}
    return caused("friction_viscous_asymmetric", "speed", numbers, {"B_f": f, "B_b": b})


def _coulomb(rng: np.random.Generator, s: Scales) -> Cause:
    F = max(s.force * about(rng, 0.03, 0.15), PLAIN * s.level)
    if rng.random() < 0.25:  # less friction than the engineer believes
        F = -rng.uniform(0.5, 0.8) * min(s.levels)
    return caused("friction_coulomb", "all", {f"level_{s.n}": F}, {"dF_f": F, "dF_b": F})


def _coulomb_asymmetric(rng: np.random.Generator, s: Scales) -> Cause:
    large, share = s.force * about(rng, 0.04, 0.15), rng.uniform(-0.1, 0.3)
    large = max(large, 2.0 * PLAIN * s.offset / (1.0 - share))  # their difference acts like a constant force
    small = max(share * large, -0.8 * min(s.levels))
    f, b = (large, small) if rng.random() < 0.5 else (small, large)
    numbers = {f"level_forward_{s.n}": f, f"level_backward_{s.n}": b}
    return caused("friction_coulomb_asymmetric", "all", numbers, {"dF_f": f, "dF_b": b}, alike=("torque_offset",))


def _stribeck(rng: np.random.Generator, s: Scales) -> Cause:
    f, b, v = s.force * about(rng, 0.04, 0.15), s.force * about(rng, 0.04, 0.15), s.speed * about(rng, 0.03, 0.12)
    numbers = {f"peak_forward_{s.n}": f, f"peak_backward_{s.n}": b, f"stribeck_speed_{s.m}_s": v}
    return caused("friction_stribeck", "low_speed", numbers, {"Fs_f": f, "Fs_b": b, "v_str": v})


def _load(rng: np.random.Generator, s: Scales) -> Cause:
    a = max(about(rng, 0.06, 0.25), PLAIN * s.level / s.load)
    alike = ("gearbox_efficiency", *_LEVELS[s.linear])
    return caused("friction_load_dependent", "load", {"friction_fraction": a}, {"a_load": a}, alike=alike)


def _gear_loss(rng: np.random.Generator, s: Scales) -> Cause:
    a = max(about(rng, 0.06, 0.25), PLAIN * s.level / s.load)
    alike = ("friction_load_dependent", *_LEVELS[s.linear])
    return caused("gearbox_efficiency", "load", {"loss_fraction": a}, {"a_load": a}, alike=alike)


def _bump(rng: np.random.Generator, s: Scales) -> Cause:
    A, w = s.force * about(rng, 0.04, 0.16), s.travel * about(rng, 0.02, 0.08)
    x = s.low + s.travel * rng.uniform(0.2, 0.7)
    numbers = {f"peak_{s.n}": A, f"centre_{s.m}": x, f"width_{s.m}": w}
    return caused("friction_position_dependent", "position", numbers, {"bump_A": A, "bump_x": x, "bump_w": w})


def _drift(rng: np.random.Generator, s: Scales) -> Cause:
    a, tau = about(rng, 0.4, 1.6), about(rng, 40.0, 200.0)
    numbers = {"friction_fraction": a, "time_constant_s": tau}
    return caused("friction_thermal_drift", "time", numbers, {"drift_a": a, "drift_tau": tau})


def _inertia(rng: np.random.Generator, s: Scales) -> Cause:
    a = max(about(rng, 0.1, 0.5), PLAIN * s.inertia)
    if rng.random() < 0.4:
        a = -min(a, 0.4)
    return caused("inertia_error", "acceleration", {"inertia_fraction": a}, {"inertia_fraction": a})


def _presliding(rng: np.random.Generator, s: Scales) -> Cause:
    d = s.travel * about(rng, 0.003, 0.03)
    return caused("presliding", "low_speed", {f"distance_{s.m}": d}, {"bristles": 1.0, "bristle": d})


def _backlash(rng: np.random.Generator, s: Scales) -> Cause:
    """Play between the motor's side and the load's, with a stiff contact on either flank.

    share: of the inertia beyond the play, which the library's entry calls load_share; friction_share: of the friction
    beyond it.
    """
    play, share = s.travel * about(rng, 0.002, 0.02), rng.uniform(0.3, 0.8)
    friction = float(np.clip(share + rng.normal(scale=0.15), 0.1, 0.95))
    truth = {
        "play": play, "on_motor": 1.0 - friction, "beyond": share, "contact_hz": about(rng, 60.0, 250.0),
        "contact_zeta": about(rng, 0.02, 0.15),
    }  # fmt: skip
    numbers = {f"play_{s.m}": play, "load_share": share, "friction_over_load_share": friction / share}
    cause = caused("backlash", "event", numbers, truth)
    return replace(cause, values={"gap": play, "share": share, "friction_share": friction})


def _gain(rng: np.random.Generator, s: Scales) -> Cause:
    change = either(rng, 0.03, 0.13)
    gain = 1.0 + math.copysign(max(abs(change), PLAIN * s.gain), change)
    return caused("torque_scale", "all", {"gain": gain}, log={"gain": gain}, subsystem="torque_sensor")


def _offset(rng: np.random.Generator, s: Scales) -> Cause:
    offset = s.force * either(rng, 0.02, 0.08)
    offset = math.copysign(max(abs(offset), PLAIN * s.offset), offset)
    return caused(
        "torque_offset", "all", {f"offset_{s.n}": offset}, log={"offset": offset}, subsystem="torque_sensor",
        alike=("friction_coulomb_asymmetric",),
    )  # fmt: skip


def _filter(rng: np.random.Generator, s: Scales) -> Cause:
    tau = max(s.ramp_s * about(rng, 0.08, 0.5), 2.0 * s.step_s)
    numbers = {"time_constant_s": tau}
    return caused("torque_filter", "acceleration", numbers, log={"filter_s": tau}, subsystem="torque_sensor")


def _delay(rng: np.random.Generator, s: Scales) -> Cause:
    """Well beyond one step of the log, which is nothing unusual."""
    delay = max(s.ramp_s * about(rng, 0.08, 0.5), 4.0 * s.step_s)
    return caused("speed_delay", "acceleration", {"delay_s": delay}, log={"delay_s": delay}, subsystem="speed_sensor")


def _ripple(rng: np.random.Generator, s: Scales) -> Cause:
    """Of an order that shows: more than a wave and a half within the travel, and not too quick for the log."""
    A, ph = s.force * about(rng, 0.02, 0.07), rng.uniform(0.0, TURN)
    low, high = 1.5 * TURN / s.travel, 0.04 * TURN / (s.speed * s.step_s)
    if s.linear:  # waves along the way, some tens of them
        n = float(min(rng.uniform(4.0, 20.0) * TURN / s.travel, high))
        numbers = {"amplitude_n": A, "waves_per_m": n / TURN, "phase_rad": ph}
        return caused("torque_ripple", "periodic", numbers, {"ripple_A": A, "ripple_n": n, "ripple_ph": ph})
    orders = [n for n in (0.5, *range(1, 13)) if low <= n <= high]
    n = float(rng.choice(orders)) if orders else low
    numbers = {"amplitude_nm": A, "order_per_turn": n, "phase_rad": ph}
    return caused("torque_ripple", "periodic", numbers, {"ripple_A": A, "ripple_n": n, "ripple_ph": ph})


LISTED: Mapping[str, AxisDraw] = {
    "friction_viscous": _viscous,
    "friction_viscous_asymmetric": _viscous_asymmetric,
    "friction_coulomb": _coulomb,
    "friction_coulomb_asymmetric": _coulomb_asymmetric,
    "friction_stribeck": _stribeck,
    "friction_load_dependent": _load,
    "gearbox_efficiency": _gear_loss,
    "friction_position_dependent": _bump,
    "friction_thermal_drift": _drift,
    "inertia_error": _inertia,
    "presliding": _presliding,
    "backlash": _backlash,
    "torque_scale": _gain,
    "torque_offset": _offset,
    "torque_filter": _filter,
    "speed_delay": _delay,
    "torque_ripple": _ripple,
}
USUAL = tuple(LISTED)
OF_A_LOAD = ("friction_load_dependent", "gearbox_efficiency")  # nothing of them shows without one
OF_NO_LOAD = ("backlash",)  # a load beyond friction keeps the teeth on one flank
# Of two effects at once: these are alike by nature, or one hides the other, so no log says which of them it holds.
ALIKE = (
    {"torque_offset", "friction_coulomb_asymmetric", "friction_coulomb"},
    {"torque_scale", "inertia_error"},
    {"gearbox_efficiency", "friction_load_dependent", "friction_coulomb"},
    {"torque_filter", "speed_delay", "inertia_error"},
    {"friction_viscous", "friction_viscous_asymmetric"},
    {"friction_stribeck", "presliding", "backlash"},
    {"backlash", "gearbox_efficiency"},  # one wants a load, the other none
    {"backlash", "friction_load_dependent"},
)


def drawn_pair(rng: np.random.Generator, first: str | None = None) -> tuple[str, str]:
    """Two effects that are not alike by nature."""
    while True:
        a, b = first or str(rng.choice(USUAL)), str(rng.choice(USUAL))
        if a != b and not any({a, b} <= group for group in ALIKE):
            return a, b


def _in_the_library(text: str, known: str, cause: Cause) -> Cause:
    return replace(cause, name=f"unlisted: {text}", library={known: cause.values})


def _quadratic(rng: np.random.Generator, s: Scales) -> Cause:
    c = s.force / s.speed**2 * about(rng, 0.04, 0.16)
    cause = caused("", "speed", {f"drag_{s.n}_s2_per_{s.m}2": c}, {"drag_c": c})
    return _in_the_library("drag that grows with the square of the speed", "friction_quadratic", cause)


def _step(rng: np.random.Generator, s: Scales) -> Cause:
    A, x, w = s.force * about(rng, 0.03, 0.12), s.low + s.travel * rng.uniform(0.25, 0.6), 0.004 * s.travel
    numbers = {f"level_{s.n}": A, f"position_{s.m}": x, f"width_{s.m}": w}
    cause = caused("", "position", numbers, {"step_A": A, "step_x": x, "step_w": w})
    return _in_the_library("the guide changes its friction at one position", "friction_step", cause)


def _wave(rng: np.random.Generator, s: Scales) -> Cause:
    A, d, ph = s.force * about(rng, 0.05, 0.16), s.travel / about(rng, 2.5, 9.0), rng.uniform(0.0, TURN)
    numbers = {f"amplitude_{s.n}": A, f"period_{s.m}": d, "phase_rad": ph}
    cause = caused("", "periodic", numbers, {"wave_A": A, "wave_d": d, "wave_ph": ph})
    return _in_the_library("friction that comes and goes along the way", "friction_periodic", cause)


def _unlisted(
    text: str, regime: str, truth: Numbers | None = None, log: Numbers | None = None, subsystem: str = "axis",
    **more: Any,
) -> Cause:  # fmt: skip
    """A cause of no list, whose values are those of the truth or of the log's sensor."""
    return Cause(f"unlisted: {text}", subsystem, regime, truth or log or {}, truth or {}, log or {}, **more)


def _of_the_log(text: str, regime: str, name: str, draw: Callable[[np.random.Generator, Scales], float]) -> AxisDraw:
    """One number of the log's sensor of force or torque, where it lies: no force on the axis has it."""
    return lambda rng, s: _unlisted(text, regime, log={name: draw(rng, s)}, subsystem="torque_sensor")


def _foreign_body(rng: np.random.Generator, s: Scales) -> Cause:
    numbers = {"body_F": s.force * about(rng, 0.04, 0.14), "body_tau": about(rng, 0.1, 2.0)}
    text = "friction that sets in at some moment of each run, as of a foreign body"
    return _unlisted(text, "time", numbers, per_run={"body_t": (1.5, 6.0)})


def _spring(rng: np.random.Generator, s: Scales) -> Cause:
    numbers = {
        "spring_k": s.force / s.travel * about(rng, 0.06, 0.25),
        "spring_x": s.low + s.travel * rng.uniform(0.3, 0.7),
    }
    return _unlisted("a cable chain pulls back like a spring", "position", numbers)


def _soft_load(rng: np.random.Generator, s: Scales) -> Cause:
    """A share of what is moved swings on a soft support, slower than the moves' ramps."""
    numbers = {
        "soft_share": rng.uniform(0.15, 0.5),
        "soft_w": TURN * rng.uniform(0.15, 0.6) / s.ramp_s,
        "soft_zeta": rng.uniform(0.01, 0.06),
    }
    return _unlisted("a part of the load swings on a soft support", "acceleration", numbers)


def _chain_end(rng: np.random.Generator, s: Scales) -> Cause:
    x = s.low + s.travel * rng.uniform(0.35, 0.6)
    far = s.low + s.travel - x
    numbers = {"chain_k": s.force * about(rng, 0.06, 0.25) / far**2, "chain_x": x}
    return _unlisted("a cable chain that pulls as it bends", "position", numbers)


def _event(what: str, name: str, draw: Callable[[np.random.Generator, Scales], float], sensor: str = "") -> AxisDraw:
    """An event in one run: `name` of the truth, or of the log's sensor where one is named."""

    def drawn(rng: np.random.Generator, s: Scales) -> Cause:
        event, size = drawn_event(rng, 0.1, 0.6), draw(rng, s)
        values, acts = {name: size, "length_s": event.length_s}, {name: size}
        truth, log = ({}, acts) if sensor else (acts, {})
        return Cause(f"unlisted: event: {what}", sensor or "axis", "event", values, truth, log, event=event)

    return drawn


EVENTS: Mapping[str, AxisDraw] = {
    "event_blow": _event("a blow against the load", "event_F", lambda rng, s: s.force * either(rng, 0.1, 0.4)),
    "event_body": _event("a foreign body in the guide, once", "event_rub",
                         lambda rng, s: s.force * about(rng, 0.1, 0.4)),
    "event_force_sensor": _event("the force sensor shows a bump that is none", "glitch",
                                 lambda rng, s: s.force * either(rng, 0.1, 0.4), "torque_sensor"),
    "event_encoder": _event("the encoder's coupling slips, and the speed is shown too low", "slip",
                            lambda rng, s: about(rng, 0.2, 0.6), "speed_sensor"),
}  # fmt: skip
UNLISTED: Mapping[str, AxisDraw] = {
    "quadratic_drag": _quadratic,
    "guide_step": _step,
    "friction_wave": _wave,
    "gain_by_direction": _of_the_log("the sensor's gain differs between the directions", "load", "gain_forward",
                                     lambda rng, s: either(rng, 0.02, 0.08)),
    "foreign_body": _foreign_body,
    "force_walk": _of_the_log("the force sensor wanders", "time", "walk_per_sqrt_s",
                              lambda rng, s: s.force * about(rng, 0.008, 0.03)),
    "dead_band": _of_the_log(
        "the force log keeps its last value until the force has changed by more than a dead band", "all", "dead_band",
        lambda rng, s: s.force * about(rng, 0.05, 0.15),
    ),
    "force_bend": _of_the_log("the force sensor is bent: an error with the force's square", "load", "bend",
                              lambda rng, s: about(rng, 0.08, 0.25) * float(rng.choice([-1.0, 1.0])) / s.force),
    "cable_chain": _spring,
    "soft_load": _soft_load,
    "chain_end": _chain_end,
    **EVENTS,
}  # fmt: skip
IN_THE_LIBRARY = ("quadratic_drag", "guide_step", "friction_wave")  # where it goes beyond the format
