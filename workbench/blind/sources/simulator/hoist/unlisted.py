"""Effects that the campaign format does not list: the right answer is "unknown", unless the library has an entry."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from workbench.blind.sources.simulator.causes import TURN, Cause, about, drawn_event, either
from workbench.blind.sources.simulator.hoist.listed import Draw, Scales


def _fan(rng: np.random.Generator, s: Scales) -> Cause:
    q = s.torque * about(rng, 0.02, 0.09) / s.motor_speed**2
    text = "unlisted: drag on the motor that grows with the square of its speed"
    return Cause(
        text, "motor", "speed", {"fan_q": q}, {"fan_q": q}, library={"motor_fan": {"drag_nm_s2": q}}
    )  # fmt: skip


def _rail_step(rng: np.random.Generator, s: Scales) -> Cause:
    A, x = s.force * about(rng, 0.02, 0.08), rng.uniform(*s.heights(0.8))
    text = "unlisted: the rail changes its friction at one height"
    return Cause(
        text, "guide", "position", {"step_A": A, "step_x": x}, {"step_A": A, "step_x": x},
        library={"friction_step": {"level_n": A, "position_m": x}},
    )  # fmt: skip


def _quadratic(rng: np.random.Generator, s: Scales) -> Cause:
    c = s.force / s.speed**2 * about(rng, 0.02, 0.09)
    text = "unlisted: drag on the carriage that grows with the square of its speed"
    return Cause(
        text, "guide", "speed", {"drag_c": c}, {"drag_c": c}, library={"friction_quadratic": {"drag_n_s2_per_m2": c}}
    )  # fmt: skip


def _roller(rng: np.random.Generator, s: Scales) -> Cause:
    A, d, ph = s.force * about(rng, 0.03, 0.10), about(rng, 0.35, 1.4), rng.uniform(0.0, TURN)
    text = "unlisted: friction that comes and goes over the height with a roller's turning"
    return Cause(
        text, "guide", "periodic", {"roller_A": A, "roller_d": d, "roller_ph": ph},
        {"roller_A": A, "roller_d": d, "roller_ph": ph},
        library={"friction_periodic": {"amplitude_n": A, "period_m": d, "phase_rad": ph}},
    )  # fmt: skip


def _gain_by_direction(rng: np.random.Generator, s: Scales) -> Cause:
    gain = about(rng, 0.015, 0.06) * float(rng.choice([-1.0, 1.0]))
    text = "unlisted: the torque sensor's gain differs between hoisting and lowering"
    return Cause(text, "torque_sensor", "load", {"gain_hoisting": gain}, log={"gain_forward": gain})


def _foreign_body(rng: np.random.Generator, s: Scales) -> Cause:
    F, tau = s.force * about(rng, 0.025, 0.09), about(rng, 0.3, 8.0)
    text = "unlisted: friction that sets in at some moment of each run, as of a foreign body"
    return Cause(
        text, "guide", "time", {"body_F": F, "body_tau": tau}, {"body_F": F, "body_tau": tau},
        per_run={"body_t": (5.0, 25.0)},
    )  # fmt: skip


def _walk(rng: np.random.Generator, s: Scales) -> Cause:
    walk = s.torque * about(rng, 0.002, 0.008)
    text = "unlisted: the torque sensor wanders"
    return Cause(text, "torque_sensor", "time", {"walk_nm_per_sqrt_s": walk}, log={"walk_per_sqrt_s": walk})


def _swinging_load(rng: np.random.Generator, s: Scales) -> Cause:
    """A share of the payload on a soft spring."""
    share, f, zeta = rng.uniform(0.5, 0.95), rng.uniform(0.35, 1.0), rng.uniform(0.01, 0.06)
    text = "unlisted: the payload hangs on a soft spring"
    m, w = share * s.payload_kg, TURN * f  # the full payload swings with f, a lesser one faster
    truth = {"hook_share": share, "hook_k": m * w * w, "hook_c": 2.0 * zeta * w * m}
    return Cause(text, "payload", "acceleration", {"hook_share": share, "hook_hz": f, "hook_zeta": zeta}, truth)


def _dead_band(rng: np.random.Generator, s: Scales) -> Cause:
    band = s.torque * about(rng, 0.025, 0.07)
    text = "unlisted: the torque log keeps its last value until the torque has changed by more than a dead band"
    return Cause(text, "torque_sensor", "all", {"dead_band_nm": band}, log={"dead_band": band})


def _bend(rng: np.random.Generator, s: Scales) -> Cause:
    """The square of the torque is missing in the log: a saturating current sensor."""
    bend = about(rng, 0.02, 0.08) / s.torque
    text = "unlisted: the torque sensor saturates with the torque's square"
    return Cause(text, "torque_sensor", "load", {"bend_per_nm": bend}, log={"bend": bend})


def _swell(rng: np.random.Generator, s: Scales) -> Cause:
    A, w, more = about(rng, 0.08, 0.3), rng.uniform(0.45, 0.9), rng.uniform(1.25, 1.6)
    text = "unlisted: the platform moves in a swell of two frequencies"
    truth = {"heave_A": A, "heave_w": w, "swell_A": A / more, "swell_w": w * more}
    phases = {"heave_ph": (0.0, TURN), "swell_ph": (0.0, TURN)}
    return Cause(text, "platform", "time", truth, truth, per_run=phases)


def _tooth(rng: np.random.Generator, s: Scales) -> Cause:
    truth = {"tooth_T": s.torque * about(rng, 0.03, 0.12), "tooth_w": rng.uniform(0.2, 0.5)}
    truth["tooth_ph"] = rng.uniform(0.0, TURN)
    text = "unlisted: a damaged tooth of the gear's last wheel drags once a turn"
    return Cause(text, "gearbox", "periodic", truth, truth)


def _dent(rng: np.random.Generator, s: Scales) -> Cause:
    """The arm is longer there: more torque at one angle, in proportion to what hangs, both ways alike."""
    th = 2.0 * rng.uniform(*s.heights(0.6)) / s.radius
    truth = {"dent_A": s.radius * about(rng, 0.02, 0.08), "dent_th": th, "dent_w": rng.uniform(0.8, 3.0)}
    text = "unlisted: the wire climbs over a crossing on the drum at one angle"
    return Cause(text, "drum", "position", truth, truth)


def _sheave_runout(rng: np.random.Generator, s: Scales) -> Cause:
    truth = {"sheave_e": s.radius * about(rng, 0.008, 0.03), "sheave_ph": rng.uniform(0.0, TURN)}
    text = "unlisted: the sheave runs out of true"
    return Cause(text, "sheave", "periodic", truth, truth)


def _event(what: str, subsystem: str, name: str, low: float, high: float, *, of_force: bool, signed: bool) -> Draw:
    """An event in one run: `name` of the truth, of the empty carriage's weight or of the motors' torque."""

    def drawn(rng: np.random.Generator, s: Scales) -> Cause:
        size = (s.force if of_force else s.torque) * (either(rng, low, high) if signed else about(rng, low, high))
        event = drawn_event(rng, 0.5, 4.0)
        values = {name: size, "length_s": event.length_s}
        return Cause(f"unlisted: event: {what}", subsystem, "event", values, {name: size}, event=event)

    return drawn


def _jolt(rng: np.random.Generator, s: Scales) -> Cause:
    jolt, event = 9.81 * either(rng, 0.015, 0.06), drawn_event(rng, 0.5, 4.0)
    values = {"event_platform": jolt, "length_s": event.length_s}
    text = "unlisted: event: the platform jolts"
    return Cause(text, "platform", "event", values, {"event_platform": jolt}, event=event)


def _glitch(rng: np.random.Generator, s: Scales) -> Cause:
    size, event = s.torque * either(rng, 0.04, 0.15), drawn_event(rng, 0.5, 4.0)
    text = "unlisted: event: the torque sensor shows a bump that is none"
    return Cause(
        text, "torque_sensor", "event", {"glitch": size, "length_s": event.length_s}, log={"glitch": size}, event=event
    )


def _slip(rng: np.random.Generator, s: Scales) -> Cause:
    slip, event = about(rng, 0.05, 0.25), drawn_event(rng, 0.5, 2.0)
    text = "unlisted: event: the encoder's coupling slips, and the speed is shown too low"
    return Cause(
        text, "speed_sensor", "event", {"slip": slip, "length_s": event.length_s}, log={"slip": slip}, event=event
    )


EVENTS: Mapping[str, Draw] = {
    "event_motor": _event(
        "a blow of torque at the motor", "motor", "event_motor", 0.04, 0.15, of_force=False, signed=True
    ),
    "event_brake": _event(
        "the brake grips while it should not", "brake", "event_brake", 0.04, 0.15, of_force=False, signed=False
    ),
    "event_drum": _event(
        "a blow of torque at the drum", "drum", "event_drum", 0.04, 0.15, of_force=False, signed=True
    ),
    "event_sheave": _event(
        "the sheave jams for a moment", "sheave", "event_sheave", 0.04, 0.15, of_force=False, signed=False
    ),
    "event_guide": _event(
        "a foreign body in the rails, once", "guide", "event_guide", 0.05, 0.2, of_force=True, signed=False
    ),
    "event_payload": _event(
        "the payload strikes or is caught", "payload", "event_payload", 0.05, 0.2, of_force=True, signed=True
    ),
    "event_platform": _jolt,
    "event_torque_sensor": _glitch,
    "event_speed_sensor": _slip,
}  # fmt: skip
UNLISTED: Mapping[str, Draw] = {
    "fan": _fan,
    "rail_step": _rail_step,
    "quadratic_drag": _quadratic,
    "roller": _roller,
    "gain_by_direction": _gain_by_direction,
    "foreign_body": _foreign_body,
    "torque_walk": _walk,
    "soft_payload": _swinging_load,
    "dead_band": _dead_band,
    "torque_bend": _bend,
    "swell": _swell,
    "tooth": _tooth,
    "wire_crossing": _dent,
    "sheave_runout": _sheave_runout,
    **EVENTS,
}
IN_THE_LIBRARY = ("fan", "rail_step", "quadratic_drag", "roller")  # of unlisted ones, where it goes beyond the format
