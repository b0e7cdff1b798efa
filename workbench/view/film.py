"""The machine moving with a run, or with two beside each other: one page of HTML that the browser animates itself.

What a log lacks of a `Scene` is computed from its measured speed.

The parts are drawn once, as SVG; a frame only moves groups of them, at the rate of the screen. Everything that moves is
computed here and handed over as samples: height, angles of the wheels, tensions. The script interpolates.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
from markupsafe import Markup

from workbench.core.names import powers
from workbench.core.numbers import figures
from workbench.core.run import Array, Run, integrated
from workbench.core.templates import render
from workbench.machines import HOIST, Hoist
from workbench.simulate.driven import InverseSimulation
from workbench.view.style import BLUE, GREY, ORANGE, VERMILLION, on_dark

INK, GROUND, FILL, NOISE = "#222222", "white", "#E9EDF2", "#C8CDD3"
FILL_DARK = "#2B303B"
LONGEST = 170.0  # px of a bar


def marked_machine(machine: Any, subsystem: str, shrink: Any) -> str:
    """SVG, self-contained, on a white ground. shrink: before, after and noise of the residual, and its unit.

    An axis is drawn along a rail, or turning, with a coupling where it has one.
    """
    turning = getattr(machine, "motion", "rotary") == "rotary"
    kind = "coupled" if hasattr(machine, "coupling") else "turning" if turning else "rail"
    largest = max(shrink.before, shrink.after, shrink.noise, 1e-12)
    bars = [
        (name, LONGEST * value / largest, powers(f"{figures(value)} {shrink.unit}"), colour)
        for name, value, colour in (
            ("before", shrink.before, GREY), ("after", shrink.after, BLUE), ("noise", shrink.noise, NOISE)
        )
    ]  # fmt: skip
    if hasattr(machine, "winch") and subsystem != "axis":
        kind = "hoist"
    return str(
        render(
            "view/place.svg.j2", kind=kind, marked=subsystem, bars=bars, ink=INK, ground=GROUND, fill=FILL, mark=ORANGE
        )
    )


def for_dark_ground(svg: str) -> str:
    """The same drawing on a dark page: ground, ink and what is not marked change, marks and bars stay."""
    for light in (INK, GROUND, GREY):
        svg = svg.replace(f'"{light}"', f'"{on_dark(light)}"')
    return svg.replace(FILL, FILL_DARK)


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
    "ink": ("#222222", "#E8E8E8"), "edge": ("#3B485C", "#AEB9C9"), "faint": ("#8590A3", "#56627A"),
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
        edges = np.searchsorted(self.time_s, time_s, side="right")
        before = np.concatenate([[0], edges[:-1]])
        slack = np.array([bool(np.any(self.slack[a : max(b, a + 1)])) for a, b in zip(before, edges, strict=True)])
        names = ("height_m", "speed_m_s", "wound_m", "tension_drum_n", "tension_dead_line_n")
        values = {name: np.interp(time_s, self.time_s, getattr(self, name)) for name in names}
        torques = tuple(np.interp(time_s, self.time_s, torque) for torque in self.torques_nm)
        return replace(self, time_s=time_s, torques_nm=torques, slack=slack, **values)


def scene_of(machine: Hoist, run: Run) -> Scene:
    """Of a simulated run what it has; of a log what it has, the rest from the nominal wire and carriage driven by the
    measured motor speed. InputError for a run whose motion cannot be computed."""
    count, both = machine.motor.count, ("torque_motor1_nm", "torque_motor2_nm")
    torques: tuple[Array, ...] = (run["torque_motor_nm"] / count,) if "torque_motor_nm" in run else ()
    if all(name in run for name in both) and count > 1:
        torques = tuple(run[name] for name in both)
    simulated = all(name in run for name in SIMULATED)
    shown = run if simulated else _driven(machine, run, np.sum(torques, axis=0) * count / len(torques))
    modelled = "simulated" if simulated else "of the model under the measured motor speed"
    logged = [name for name in ("position_carriage_m", "tension_dead_line_n") if name in run and not simulated]
    height, dead = ((run if name in logged else shown)[name] for name in ("position_carriage_m", "tension_dead_line_n"))
    speed = run["speed_motor_rad_s"]
    angle = integrated(speed, run.time_s)
    return Scene(
        run.name, run.payload_kg, run.time_s, np.asarray(height, dtype=float),
        np.asarray(shown["speed_carriage_m_s"], dtype=float),
        2.0 * (run.start_position_m + machine.lift_m_per_rad * angle),  # two falls, so twice the height to begin with
        torques, np.asarray(shown["tension_drum_n"], dtype=float), np.asarray(dead, dtype=float),
        np.asarray(shown["tension_min_n"]) <= 0.0,
        f"measured at the dead line, {modelled} at the drum" if "tension_dead_line_n" in logged else modelled,
        "measured" if "position_carriage_m" in logged else modelled,
    )  # fmt: skip


def _driven(machine: Hoist, run: Run, torque: Array) -> Mapping[str, Any]:
    """The plant's outputs along the measured motor speed, without the machine's effects."""
    bench = InverseSimulation(machine.model_copy(update={"effects": {}}), [run])
    (balance,) = bench.balances()
    motion, states, n = balance.motion, balance.states, len(HOIST.plant.positions)
    start = HOIST.plant.equilibrium(float(states[0, 1]), bench.base[0])[0][0]
    q = [motion.position - motion.position[0] + start, *states[:, : n - 1].T]
    return HOIST.plant.outputs(run.time_s, q, [motion.speed, *states[:, n - 1 :].T], torque, bench.base[0])


def look_of(dark: bool) -> SimpleNamespace:
    """Colours; steel, arm, wheel, pipe: fills."""
    return SimpleNamespace(**{name: colours[dark] for name, colours in LOOK.items()})


def film(machine: Hoist, scenes: Sequence[Scene], dark: bool = False, height: int = HEIGHT) -> str:
    """A page that needs nothing else. scenes: one run, or two of the same machine."""
    look, data = look_of(dark), film_data(machine, scenes)
    data["viridis"] = VIRIDIS[3:] if dark else VIRIDIS[:5]  # of a contrast of 3:1 with the ground
    stages = [_stage(machine, scene, look, number) for number, scene in enumerate(scenes)]
    # A name of somebody's must not end the script.
    text = Markup(json.dumps(data, allow_nan=False).replace("<", "\\u003c"))
    page = render(
        "view/film.html.j2", look=look, ground="#0E1117" if dark else "#FFFFFF", height=height, strips=_strips(data),
        stages=stages, data=text, width=f"{STRIP_WIDTH:g}", deep=f"{STRIP_HEIGHT:g}", colours=COLOURS,
    )  # fmt: skip
    return str(page)


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
    s = sizes(machine)
    return {
        "start_s": begin,
        "step_s": float(time[1] - time[0]),
        "samples": n,
        "largest_kn": max(largest, 1.0) / 1000.0,
        "top": s.top,
        "drum": [s.drum_x, s.top],
        "strip": [STRIP_WIDTH, STRIP_HEIGHT],
        "runs": [_run(scene.at(time), s) for scene in scenes],
    }


def _run(scene: Scene, s: SimpleNamespace) -> dict[str, Any]:
    torques = np.array(scene.torques_nm)
    harder = np.argmax(np.abs(torques), axis=0)
    values = {
        "height_m": (scene.height_m, 4),
        "drum_deg": (np.degrees(scene.wound_m / s.R), 2),
        "sheave_deg": (np.degrees(-scene.wound_m / (2.0 * s.r)), 2),
        "speed_m_s": (scene.speed_m_s, 4),
        "torque_nm": (np.take_along_axis(torques, harder[None], axis=0)[0], 1),
        "tension_kn": (scene.tension_drum_n / 1000.0, 2),
        "dead_kn": (scene.tension_dead_line_n / 1000.0, 2),
    }
    short = {name: np.nan_to_num(of).round(digits).tolist() for name, (of, digits) in values.items()}
    return {"name": scene.name, **short, "slack": scene.slack.astype(int).tolist()}


def _stage(machine: Hoist, scene: Scene, look: SimpleNamespace, number: int) -> Markup:
    """One machine, drawn."""
    drawing = {of.__name__: of for of in (path, box, circle, spokes, link, zigzag, hatch)}
    half = half_pipe(sizes(machine), scene.payload_kg, machine.carriage.mass_kg)
    return render(
        "view/film_stage.j2", s=sizes(machine), half=half, look=look, number=number, title=scene.name,
        colour=COLOURS[number % 2], f=format, **drawing,
    )  # fmt: skip


def _strips(data: dict[str, Any]) -> list[tuple[str, str, str, list[str]]]:
    """Speed, torque and tension over the whole time: title, ends, and each run's line."""
    made = []
    for key, title in STRIPS:
        values = [run[key] for run in data["runs"]]
        low, high = (pick(pick(strip) for strip in values) for pick in (min, max))
        lines = []
        for strip in values:
            y = STRIP_HEIGHT * (0.96 - 0.92 * (np.array(strip) - low) / ((high - low) or 1.0))
            kept = range(0, len(strip), max(1, len(strip) // 1000))
            lines.append(" ".join(f"{STRIP_WIDTH * k / (len(strip) - 1):.1f},{y[k]:.1f}" for k in kept))
        ends = [f"{end:.4g}".replace("-", "\N{MINUS SIGN}") for end in (low, high)]
        made.append((title, ends[0], ends[1], lines))
    return made


# The machine as it is drawn: its sizes in m, and outlines as the `d` of SVG paths; film_stage.j2 has the parts.

Point = tuple[float, float]


def sizes(machine: Hoist) -> SimpleNamespace:
    """How large things are drawn: heights to scale, parts larger, all by one unit u (m).

    Fall 1 runs at -r, fall 2 at +r, the sheave's axis at the carriage's height. The drum's axis is at the top of the
    falls. mast: left and right chord, the left one is the guide rail. beam: bottom and top of what carries the winch.
    reach: where the gripper holds the pipe. Wheels turn as the drawn wire runs, so magnified ones turn less often than
    the real ones.
    """
    low, top = machine.rail.lowest_position_m, machine.wire.segment_length_m
    u = (top - low) / 22.0
    R = 1.55 * u
    # The sheave beside the drum as it really is, within what can be seen.
    r = R * min(max(machine.sheave.diameter_m / machine.winch.drum_diameter_m, 0.6), 1.3)
    mast, beam = (r + 1.3 * u, r + 3.3 * u), (top + R + 0.45 * u, top + R + 1.25 * u)
    floor, reach = low - 3.3 * u, -r - 6.2 * u
    return SimpleNamespace(
        low=low, top=top, u=u, R=R, r=r, drum_x=-r - R, mast=mast, beam=beam, floor=floor, reach=reach,
        y_range=(floor - 0.7 * u, beam[1] + 2.0 * u), x_range=(reach - 3.4 * u, mast[1] + 0.6 * u),
    )  # fmt: skip


def half_pipe(s: SimpleNamespace, payload_kg: float, carriage_kg: float) -> float:
    """Half the drawn width of the payload: its cross-section grows with its mass; 0 for none."""
    return 0.0 if payload_kg <= 0.0 else s.u * (0.1 + 0.22 * min(math.sqrt(payload_kg / carriage_kg), 1.5))


def path(points: Sequence[Point]) -> str:
    return "M" + "L".join(f"{x:.4g} {y:.4g}" for x, y in points)


def box(left: float, bottom: float, right: float, top: float) -> str:
    return path([(left, bottom), (right, bottom), (right, top), (left, top), (left, bottom)])


def circle(radius: float, x: float = 0.0, y: float = 0.0, begins: float = 0.0) -> str:
    """From a share of the turn to its end."""
    angles = 2.0 * math.pi * np.linspace(begins, 1.0, 49)
    return path([(x + radius * math.cos(a), y + radius * math.sin(a)) for a in angles])


def spokes(radius: float) -> str:
    ends = [(radius * math.cos(a), radius * math.sin(a)) for a in 2.0 * math.pi * np.arange(3) / 3.0]
    return "".join(path([(0.22 * x, 0.22 * y), (x, y)]) for x, y in ends)


def link(x0: float, y0: float, x1: float, y1: float, half: float) -> str:
    """A bar from one point to the other, so thick to each side."""
    length = math.dist((x0, y0), (x1, y1))
    x, y = (y0 - y1) / length * half, (x1 - x0) / length * half
    return path([(x0 + x, y0 + y), (x1 + x, y1 + y), (x1 - x, y1 - y), (x0 - x, y0 - y), (x0 + x, y0 + y)])


def zigzag(left: float, right: float, low: float, high: float) -> str:
    return path([(left if k % 2 == 0 else right, float(y)) for k, y in enumerate(np.linspace(low, high, 15))])


def hatch(left: float, right: float, step: float, y: float, across: float, down: float) -> str:
    return "".join(path([(x, y), (x - across, y - down)]) for x in np.arange(left, right, step))
