"""The machine moving with a run, or with two beside each other: one page of HTML that the browser animates itself.

What a log lacks of a `Scene` is computed from its measured speed.

The parts are drawn once, as SVG; a frame only moves groups of them, at the rate of the screen. Everything that moves is
computed here and handed over as samples: height, angles of the wheels, tensions. The script interpolates.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from workbench.core.run import Array, Run
from workbench.core.templates import render
from workbench.machines import HOIST, Hoist
from workbench.simulate.driven import InverseSimulation
from workbench.view import arm_parts as parts
from workbench.view.style import VERMILLION

HEIGHT = 640  # px
STEP_S, MOST_SAMPLES = 0.02, 4000
STRIPS = (("speed_m_s", "speed (m/s)"), ("torque_nm", "torque per motor (N m)"), ("tension_kn", "drum tension (kN)"))
STRIP_WIDTH, STRIP_HEIGHT = 1000.0, 100.0
COLOURS = ("#D55E00", "#0072B2")
SIMULATED = ("position_carriage_m", "speed_carriage_m_s", "tension_drum_n", "tension_dead_line_n", "tension_min_n")

# Viridis in eight steps: even in lightness, and read alike by the colour-blind (S. van der Walt, N. Smith, 2015).
VIRIDIS = (
    (68, 1, 84), (70, 51, 127), (54, 92, 141), (39, 127, 142), (31, 161, 135), (74, 194, 109), (159, 218, 58),
    (253, 231, 37),
)  # fmt: skip


# On the light ground and on the dark one.
LOOK = {
    "ink": ("#222222", "#E8E8E8"), "edge": ("#3B485C", "#AEB9C9"), "faint": ("#9AA5B5", "#56627A"),
    "grid": ("#E4E4E4", "#2B303B"), "steel": ("#E6EAF1", "#232B39"), "arm": ("#BFD5EA", "#33506B"),
    "wheel": ("#F7F8FA", "#2A3342"), "pipe": ("#CDBB92", "#8A7A5C"), "accent": ("#0072B2", "#56B4E9"),
    "alarm": (VERMILLION, "#FF8A3D"),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Scene:
    """A run as the drawing needs it; arrays (n,) over rising time_s, up and hoisting positive.

    wound_m: wire taken in by the drum since height 0. torques_nm: one motor each. slack: either fall. tension_of,
    height_of: where these come from.
    """

    name: str
    payload_kg: float
    time_s: Array
    height_m: Array
    speed_m_s: Array
    wound_m: Array
    torques_nm: tuple[Array, ...]
    tension_drum_n: Array
    tension_dead_line_n: Array
    slack: np.ndarray
    tension_of: str = "simulated"
    height_of: str = "simulated"

    def at(self, time_s: Array) -> Scene:
        """The scene at other times. Slack is kept where there was any since the time before."""

        def between(values: Array) -> Array:
            return np.interp(time_s, self.time_s, values)

        edges = np.searchsorted(self.time_s, time_s, side="right")
        before = np.concatenate([[0], edges[:-1]])
        slack = np.array([bool(np.any(self.slack[a : max(b, a + 1)])) for a, b in zip(before, edges, strict=True)])
        return Scene(
            self.name, self.payload_kg, time_s, between(self.height_m), between(self.speed_m_s), between(self.wound_m),
            tuple(between(torque) for torque in self.torques_nm), between(self.tension_drum_n),
            between(self.tension_dead_line_n), slack, self.tension_of, self.height_of,
        )  # fmt: skip


def scene_of(machine: Hoist, run: Run) -> Scene:
    """Of a simulated run what it has; of a log what it has, the rest from the nominal wire and carriage driven by the
    measured motor speed. InputError for a run whose motion cannot be computed."""
    torques, simulated = _torques(machine, run), all(name in run for name in SIMULATED)
    shown = run if simulated else _driven(machine, run, np.sum(torques, axis=0) * machine.motor.count / len(torques))
    logged = ("position_carriage_m", "tension_dead_line_n")
    height, dead = (np.asarray((run if name in run else shown)[name], dtype=float) for name in logged)
    modelled = "simulated" if simulated else "of the model under the measured motor speed"
    of = [f"measured at the dead line, {modelled} at the drum", "measured"]
    tension_of, height_of = (
        said if name in run and not simulated else modelled for name, said in zip(logged[::-1], of, strict=True)
    )
    return Scene(
        run.name, run.payload_kg, run.time_s, height, np.asarray(shown["speed_carriage_m_s"], dtype=float),
        _wound(machine, run, run.start_position_m), torques, np.asarray(shown["tension_drum_n"], dtype=float), dead,
        np.asarray(shown["tension_min_n"]) <= 0.0, tension_of, height_of,
    )  # fmt: skip


def _driven(machine: Hoist, run: Run, torque: Array) -> Mapping[str, Any]:
    """The plant's outputs along the measured motor speed, without the machine's effects."""
    bench = InverseSimulation(machine.model_copy(update={"effects": {}}), [run])
    (balance,) = bench.balances()
    motion, states, n = balance.motion, balance.states, len(HOIST.plant.positions)
    start = HOIST.plant.equilibrium(float(states[0, 1]), bench.base[0])[0][0]
    q = [motion.position - motion.position[0] + start, *states[:, : n - 1].T]
    return HOIST.plant.outputs(run.time_s, q, [motion.speed, *states[:, n - 1 :].T], torque, bench.base[0])


def _torques(machine: Hoist, run: Run) -> tuple[Array, ...]:
    """One motor each; equal parts of the sum where only that is logged."""
    if "torque_motor1_nm" in run and "torque_motor2_nm" in run and machine.motor.count > 1:
        return run["torque_motor1_nm"], run["torque_motor2_nm"]
    return (run["torque_motor_nm"] / machine.motor.count,)


def _wound(machine: Hoist, run: Run, start_m: float) -> Array:
    """Wire (m) that the drum has taken in, from its motor's speed: two falls, so twice the height to begin with."""
    speed = run["speed_motor_rad_s"]
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(run.time_s))])
    return 2.0 * (start_m + machine.lift_m_per_rad * angle)


def look_of(dark: bool) -> SimpleNamespace:
    """Colours; steel, arm, wheel, pipe: fills."""
    return SimpleNamespace(**{name: colours[dark] for name, colours in LOOK.items()})


def film(machine: Hoist, scenes: Sequence[Scene], dark: bool = False, height: int = HEIGHT) -> str:
    """A page that needs nothing else. scenes: one run, or two of the same machine."""
    look = look_of(dark)
    data = film_data(machine, scenes)
    columns = "".join(_stage(machine, scene, look, number) for number, scene in enumerate(scenes))
    page = _page()
    for name, text in {
        "INK": look.ink, "GROUND": "#0E1117" if dark else "#FFFFFF", "EDGE": look.edge, "GRID": look.grid,
        "ALARM": look.alarm, "ACCENT": look.accent, "HEIGHT": str(height), "STAGES": columns,
        "STRIPS": _strips(data, look),
        # A name of somebody's must not end the script.
        "DATA": json.dumps(data, allow_nan=False).replace("<", "\\u003c"),
    }.items():  # fmt: skip
        page = page.replace(f"@{name}@", text)
    return page


def film_data(machine: Hoist, scenes: Sequence[Scene]) -> dict[str, Any]:
    """What the script moves the parts by.

    start_s, step_s: of the samples, common to all runs. runs: each with samples of height_m, of the angles of drum and
    sheave as drawn (degrees, counter-clockwise positive), and of what is written beside it.
    """
    begin = min(float(scene.time_s[0]) for scene in scenes)
    end = max(float(scene.time_s[-1]) for scene in scenes)
    n = min(MOST_SAMPLES, max(2, math.ceil((end - begin) / STEP_S) + 1))
    time = np.linspace(begin, end, n)
    largest = max(float(np.max([s.tension_drum_n, s.tension_dead_line_n])) for s in scenes)
    s = parts.sizes(machine)
    return {
        "start_s": begin,
        "step_s": float(time[1] - time[0]),
        "samples": n,
        "largest_kn": max(largest, 1.0) / 1000.0,
        "viridis": [list(colour) for colour in VIRIDIS],
        "top": s.top,
        "drum": [s.drum_x, s.top],
        "strip": [STRIP_WIDTH, STRIP_HEIGHT],
        "runs": [_run(scene.at(time), s) for scene in scenes],
    }


def _run(scene: Scene, s: parts.Sizes) -> dict[str, Any]:
    torques = np.array(scene.torques_nm)
    harder = np.argmax(np.abs(torques), axis=0)

    def short(values: Array, digits: int) -> list[float]:
        return [round(float(value), digits) for value in np.nan_to_num(values)]

    return {
        "name": scene.name,
        "height_m": short(scene.height_m, 4),
        "drum_deg": short(np.degrees(scene.wound_m / s.R), 2),
        "sheave_deg": short(np.degrees(-scene.wound_m / (2.0 * s.r)), 2),
        "speed_m_s": short(scene.speed_m_s, 4),
        "torque_nm": short(np.take_along_axis(torques, harder[None], axis=0)[0], 1),
        "tension_kn": short(scene.tension_drum_n / 1000.0, 2),
        "dead_kn": short(scene.tension_dead_line_n / 1000.0, 2),
        "slack": [int(flag) for flag in scene.slack],
    }


def _stage(machine: Hoist, scene: Scene, look: SimpleNamespace, number: int) -> str:
    """One machine, drawn."""
    drawing = {name: getattr(parts, name) for name in ("path", "box", "circle", "spokes", "link", "zigzag", "hatch")}
    half = parts.half_pipe(parts.sizes(machine), scene.payload_kg, machine.carriage.mass_kg)
    return render(
        "view/film_stage.j2", s=parts.sizes(machine), half=half, look=look, number=number, title=scene.name,
        colour=COLOURS[number % 2], f=format, **drawing,
    )  # fmt: skip


def _strips(data: dict[str, Any], look: SimpleNamespace) -> str:
    """Speed, torque and tension over the whole time, with a line that goes along."""
    made = []
    for key, title in STRIPS:
        values = [run[key] for run in data["runs"]]
        low, high = (pick(pick(strip) for strip in values) for pick in (min, max))
        span = (high - low) or 1.0
        lines = []
        for number, strip in enumerate(values):
            kept = range(0, len(strip), max(1, len(strip) // 1000))
            points = " ".join(
                f"{STRIP_WIDTH * k / (len(strip) - 1):.1f},{STRIP_HEIGHT * (0.96 - 0.92 * (strip[k] - low) / span):.1f}"
                for k in kept
            )
            lines.append(f'<polyline points="{points}" fill="none" stroke="{COLOURS[number % 2]}" stroke-width="1.6" '
                         'vector-effect="non-scaling-stroke"/>')  # fmt: skip
        made.append(
            f'<div class="strip"><span>{title}: {_shown(low)} to {_shown(high)}</span>'
            f'<svg viewBox="0 0 {STRIP_WIDTH:g} {STRIP_HEIGHT:g}" preserveAspectRatio="none">{"".join(lines)}'
            f'<line class="now" x1="0" x2="0" y1="0" y2="{STRIP_HEIGHT:g}" stroke="{look.ink}" '
            'vector-effect="non-scaling-stroke"/></svg></div>'
        )
    return "".join(made)


def _shown(value: float) -> str:
    return f"{value:.4g}".replace("-", "\N{MINUS SIGN}")


@cache
def _page() -> str:
    return Path(__file__).with_name("film.html").read_text(encoding="utf-8")
