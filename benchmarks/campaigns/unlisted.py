"""Effects that the campaign format does not list: the right answer is "unknown", unless the library has an entry."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchmarks.campaigns.listed import TURN, Cause, Draw, Scales, about


def _fan(rng: np.random.Generator, s: Scales) -> Cause:
    q = s.torque * about(rng, 0.02, 0.09) / s.motor_speed**2
    text = "unlisted: drag on the motor that grows with the square of its speed"
    return Cause(
        text, "motor", "speed", {"fan_q": q}, {"fan_q": q}, library={"motor_fan": {"drag_nm_s2": q}}
    )  # fmt: skip


def _rail_step(rng: np.random.Generator, s: Scales) -> Cause:
    A, x = s.force * about(rng, 0.02, 0.08), rng.uniform(s.low_m + 0.8, s.high_m - 0.8)
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
    return Cause(text, "torque_sensor", "load", {"gain_hoisting": gain}, log={"gain_hoisting": gain})


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
    return Cause(text, "torque_sensor", "time", {"walk_nm_per_sqrt_s": walk}, log={"walk_nm_per_sqrt_s": walk})


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
    return Cause(text, "torque_sensor", "all", {"dead_band_nm": band}, log={"dead_band_nm": band})


def _bend(rng: np.random.Generator, s: Scales) -> Cause:
    """The square of the torque is missing in the log: a saturating current sensor."""
    bend = about(rng, 0.02, 0.08) / s.torque
    text = "unlisted: the torque sensor saturates with the torque's square"
    return Cause(text, "torque_sensor", "load", {"bend_per_nm": bend}, log={"bend_per_nm": bend})


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
}
IN_THE_LIBRARY = ("fan", "rail_step", "quadratic_drag", "roller")  # of unlisted ones, where it goes beyond the format
