"""Effects on an axis that the campaign format does not list: "unknown" is right, unless the library has an entry."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from workbench.blind.sources.simulator.axis.listed import AxisDraw, Scales, caused
from workbench.blind.sources.simulator.causes import TURN, Cause, about, drawn_event, either


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


def _plain(text: str, regime: str, cause: Cause) -> Cause:
    return replace(cause, name=f"unlisted: {text}", regime=regime, library={})


def _gain_by_direction(rng: np.random.Generator, s: Scales) -> Cause:
    gain = {"gain_forward": either(rng, 0.02, 0.08)}
    return _plain("the sensor's gain differs between the directions", "load", caused("", "", gain, log=gain))


def _foreign_body(rng: np.random.Generator, s: Scales) -> Cause:
    numbers = {"body_F": s.force * about(rng, 0.04, 0.14), "body_tau": about(rng, 0.1, 2.0)}
    cause = replace(caused("", "", numbers, numbers), per_run={"body_t": (1.5, 6.0)})
    return _plain("friction that sets in at some moment of each run, as of a foreign body", "time", cause)


def _walk(rng: np.random.Generator, s: Scales) -> Cause:
    numbers = {"walk_per_sqrt_s": s.force * about(rng, 0.008, 0.03)}
    return _plain("the force sensor wanders", "time", caused("", "", numbers, log=numbers))


def _dead_band(rng: np.random.Generator, s: Scales) -> Cause:
    numbers = {"dead_band": s.force * about(rng, 0.05, 0.15)}
    text = "the force log keeps its last value until the force has changed by more than a dead band"
    return _plain(text, "all", caused("", "", numbers, log=numbers))


def _bend(rng: np.random.Generator, s: Scales) -> Cause:
    numbers = {"bend": about(rng, 0.08, 0.25) * float(rng.choice([-1.0, 1.0])) / s.force}
    return _plain(
        "the force sensor is bent: an error with the force's square", "load", caused("", "", numbers, log=numbers)
    )


def _spring(rng: np.random.Generator, s: Scales) -> Cause:
    numbers = {
        "spring_k": s.force / s.travel * about(rng, 0.06, 0.25),
        "spring_x": s.low + s.travel * rng.uniform(0.3, 0.7),
    }
    return _plain("a cable chain pulls back like a spring", "position", caused("", "", numbers, numbers))


def _soft_load(rng: np.random.Generator, s: Scales) -> Cause:
    """A share of what is moved swings on a soft support, slower than the moves' ramps."""
    numbers = {
        "soft_share": rng.uniform(0.15, 0.5),
        "soft_w": TURN * rng.uniform(0.15, 0.6) / s.ramp_s,
        "soft_zeta": rng.uniform(0.01, 0.06),
    }
    return _plain("a part of the load swings on a soft support", "acceleration", caused("", "", numbers, numbers))


def _chain_end(rng: np.random.Generator, s: Scales) -> Cause:
    x = s.low + s.travel * rng.uniform(0.35, 0.6)
    far = s.low + s.travel - x
    numbers = {"chain_k": s.force * about(rng, 0.06, 0.25) / far**2, "chain_x": x}
    return _plain("a cable chain that pulls as it bends", "position", caused("", "", numbers, numbers))


def _blow(rng: np.random.Generator, s: Scales) -> Cause:
    event, size = drawn_event(rng, 0.1, 0.6), s.force * either(rng, 0.1, 0.4)
    cause = caused("", "", {"event_F": size, "length_s": event.length_s}, {"event_F": size})
    return _plain("event: a blow against the load", "event", replace(cause, event=event))


def _body_once(rng: np.random.Generator, s: Scales) -> Cause:
    event, size = drawn_event(rng, 0.1, 0.6), s.force * about(rng, 0.1, 0.4)
    cause = caused("", "", {"event_rub": size, "length_s": event.length_s}, {"event_rub": size})
    return _plain("event: a foreign body in the guide, once", "event", replace(cause, event=event))


def _glitch(rng: np.random.Generator, s: Scales) -> Cause:
    event, size = drawn_event(rng, 0.1, 0.6), s.force * either(rng, 0.1, 0.4)
    cause = caused("", "", {"glitch": size, "length_s": event.length_s}, log={"glitch": size})
    cause = replace(cause, event=event, subsystem="torque_sensor")
    return _plain("event: the force sensor shows a bump that is none", "event", cause)


def _slip(rng: np.random.Generator, s: Scales) -> Cause:
    event, slip = drawn_event(rng, 0.1, 0.6), about(rng, 0.2, 0.6)
    cause = caused("", "", {"slip": slip, "length_s": event.length_s}, log={"slip": slip})
    cause = replace(cause, event=event, subsystem="speed_sensor")
    return _plain("event: the encoder's coupling slips, and the speed is shown too low", "event", cause)


EVENTS: Mapping[str, AxisDraw] = {
    "event_blow": _blow,
    "event_body": _body_once,
    "event_force_sensor": _glitch,
    "event_encoder": _slip,
}
UNLISTED: Mapping[str, AxisDraw] = {
    "quadratic_drag": _quadratic,
    "guide_step": _step,
    "friction_wave": _wave,
    "gain_by_direction": _gain_by_direction,
    "foreign_body": _foreign_body,
    "force_walk": _walk,
    "dead_band": _dead_band,
    "force_bend": _bend,
    "cable_chain": _spring,
    "soft_load": _soft_load,
    "chain_end": _chain_end,
    **EVENTS,
}
IN_THE_LIBRARY = ("quadratic_drag", "guide_step", "friction_wave")  # where it goes beyond the format
