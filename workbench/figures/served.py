"""A served plant's last seconds and how late its steps began, as SVG: drawn anew twice a second without a flicker."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape

import numpy as np
import numpy.typing as npt

from workbench.core.run import Array
from workbench.view.style import BLUE, FAINT, GREY, ORANGE, SKY, VERMILLION, on_dark
from workbench.view.thin import thin

WIDTH, ROW, GAP, LEFT, RIGHT, TOP, BOTTOM = 1000.0, 104.0, 16.0, 84.0, 12.0, 8.0, 34.0  # px
INK, GROUND = "#222222", "white"
MOST_POINTS, TICKS = 600, 4
# A row: its title, and its lines: column, words, colour, dash, factor.
Line = tuple[str, str, str, str, float]
ROWS: tuple[tuple[str, tuple[Line, ...]], ...] = (
    ("height (m)", (("position_carriage_m", "height", BLUE, "", 1.0),)),
    ("speed (rad/s)", (
        ("speed_reference_rad_s", "set point", GREY, "2 2", 1.0), ("speed_motor_rad_s", "motor", VERMILLION, "", 1.0),
    )),
    ("torque (N m)", (
        ("torque_motor_nm", "asked for", GREY, "2 2", 1.0), ("torque_at_work_nm", "at work", ORANGE, "", 1.0),
    )),
    ("tension (kN)", (
        ("tension_drum_n", "drum", BLUE, "", 1e-3), ("tension_dead_line_n", "dead line", SKY, "", 1e-3),
        ("tension_min_n", "least", VERMILLION, "4 2", 1e-3),
    )),
)  # fmt: skip


def last_seconds(
    columns: Mapping[str, Array],
    window_s: float,
    torque_limit_nm: float,
    events: Sequence[tuple[float, str]] = (),
    dark: bool = False,
) -> str:
    """Height, speed with its set point, torque asked for and at work, tensions, over the last `window_s`.

    columns: name -> (n,), among them `time_s`, by the names of `workbench serve`. events: (time_s, words), each a line
    through all rows. The drive's limit of torque is drawn where the torque comes near it.
    """
    time = columns["time_s"]
    first, last = (float(time[0]), float(time[-1])) if len(time) else (0.0, 0.0)
    start = max(last - window_s, first)
    shown = time >= start
    height = TOP + len(ROWS) * (ROW + GAP) - GAP + BOTTOM
    scale = (WIDTH - LEFT - RIGHT) / window_s
    drawn = []
    for number, (title, lines) in enumerate(ROWS):
        top = TOP + number * (ROW + GAP)
        level = torque_limit_nm if title.startswith("torque") else None
        drawn.append(_row(title, lines, columns, shown, time[shown], (start, scale, top), level))
    for k in range(math.ceil(start / _step(window_s)), math.floor((start + window_s) / _step(window_s)) + 1):
        x = LEFT + scale * (k * _step(window_s) - start)
        drawn.append(_text(x, height - 18.0, f"{k * _step(window_s):g}", "middle"))
    drawn.append(_text(LEFT + 0.5 * (WIDTH - LEFT - RIGHT), height - 3.0, "time of the plant (s)", "middle"))
    for at, words in events:
        if start <= at <= start + window_s:
            x = LEFT + scale * (at - start)
            drawn.append(_path([(x, TOP), (x, height - BOTTOM)], VERMILLION, "2 3", 1.2))
            drawn.append(
                f'<text x="{x - 4:.1f}" y="{TOP + 2:.1f}" font-size="11" fill="{VERMILLION}" text-anchor="end" '
                f'transform="rotate(-90 {x - 4:.1f} {TOP + 2:.1f})">{escape(words)}</text>'
            )
    return _svg(drawn, height, dark)


def _row(
    title: str,
    lines: Sequence[Line],
    columns: Mapping[str, Array],
    shown: npt.NDArray[np.bool_],
    time: Array,
    place: tuple[float, float, float],
    limit: float | None,
) -> str:
    """One quantity. place: time at the left edge (s), px a second, px of the upper edge."""
    start, scale, top = place
    values = {name: factor * columns[name][shown] for name, _, _, _, factor in lines}
    known = np.concatenate([v[np.isfinite(v)] for v in values.values()])
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    near = limit is not None and len(known) and max(-low, high) > 0.7 * limit
    if limit is not None and near:
        low, high = min(low, -limit if -low > high else low), max(high, limit if high >= -low else high)
    low, high = _room(low, high)

    def y(value: float) -> float:
        return top + ROW * (high - value) / (high - low)

    drawn = [_path([(LEFT, top), (LEFT, top + ROW)], GREY, "", 1.0)]
    tick = _step(high - low)
    for k in range(math.ceil(low / tick), math.floor(high / tick) + 1):
        drawn.append(_path([(LEFT, y(k * tick)), (WIDTH - RIGHT, y(k * tick))], FAINT, "", 1.0))
        drawn.append(_text(LEFT - 6.0, y(k * tick) + 4.0, f"{k * tick:g}".replace("-", "\N{MINUS SIGN}"), "end"))
    if limit is not None and near:
        at = limit if high >= limit else -limit
        drawn.append(_path([(LEFT, y(at)), (WIDTH - RIGHT, y(at))], GREY, "6 4", 1.2))
    x_legend = LEFT + 8.0
    for name, words, colour, dash, _ in lines:
        if not np.any(np.isfinite(values[name])):
            continue
        for t, v in _unbroken(*thin(time, values[name], MOST_POINTS)):
            points = [(LEFT + scale * (a - start), y(b)) for a, b in zip(t, v, strict=True)]
            drawn.append(_path(points, colour, dash, 1.7))
        drawn.append(_path([(x_legend, top + 7.0), (x_legend + 20.0, top + 7.0)], colour, dash, 2.2))
        drawn.append(_text(x_legend + 25.0, top + 11.0, words, "start"))
        x_legend += 45.0 + 7.0 * len(words)
    middle = top + 0.5 * ROW
    drawn.append(
        f'<text x="16" y="{middle:.1f}" font-size="12" fill="{INK}" text-anchor="middle" '
        f'transform="rotate(-90 16 {middle:.1f})">{title}</text>'
    )
    return "".join(drawn)


def _room(low: float, high: float) -> tuple[float, float]:
    """A range that shows noise at rest as small, with room for the legend above."""
    span = max(high - low, 0.02 * max(abs(low), abs(high)), 1e-3)
    return low - 0.08 * span, high + 0.25 * span


def _step(span: float) -> float:
    """A round step of a scale: 1, 2 or 5 times a power of ten, some TICKS in the span."""
    size = 10.0 ** math.floor(math.log10(span / TICKS))
    return next(k * size for k in (1.0, 2.0, 5.0, 10.0) if span / (k * size) <= TICKS)


def _unbroken(time: Array, values: Array) -> list[tuple[Array, Array]]:
    """The stretches of a line between samples that are no numbers."""
    breaks = np.flatnonzero(~np.isfinite(values))
    parts = [(t, v) for t, v in zip(np.split(time, breaks), np.split(values, breaks), strict=True)]
    cleaned = [(t[np.isfinite(v)], v[np.isfinite(v)]) for t, v in parts]
    return [(t, v) for t, v in cleaned if len(t) > 1]


def late_starts(jitter: Mapping[str, int], dark: bool = False) -> str:
    """How late the steps began, a bar a class. jitter: name of a class ("<50 us") -> steps."""
    steps = max(sum(jitter.values()), 1)
    height, base, width = 190.0, 140.0, WIDTH / 1.6 / len(jitter)
    drawn = []
    for number, (name, count) in enumerate(jitter.items()):
        x, tall = 10.0 + number * width, 110.0 * count / steps
        drawn.append(
            f'<rect x="{x:.1f}" y="{base - tall:.1f}" width="{0.8 * width:.1f}" height="{tall:.1f}" fill="{BLUE}"/>'
        )
        share = f"{100.0 * count / steps:.2g} %" if count else "0"
        drawn.append(_text(x + 0.4 * width, base - tall - 4.0, share, "middle"))
        words = name.replace("us", "µs").replace("<", "< ").replace(">=", "≥ ").removesuffix(" µs")
        drawn.append(_text(x + 0.4 * width, base + 16.0, words, "middle"))
    drawn.append(_text(0.5 * WIDTH / 1.6, base + 38.0, "how late the steps began (µs)", "middle"))
    return _svg(drawn, height, dark, WIDTH / 1.6 + 10.0)


def _path(points: Sequence[tuple[float, float]], colour: str, dash: str, width: float) -> str:
    way = "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
    dashed = f' stroke-dasharray="{dash}"' if dash else ""
    return f'<path d="M{way}" fill="none" stroke="{colour}" stroke-width="{width}"{dashed}/>'


def _text(x: float, y: float, words: str, anchor: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" font-size="12" fill="{INK}" text-anchor="{anchor}">{escape(words)}</text>'


def _svg(drawn: Sequence[str], height: float, dark: bool, width: float = WIDTH) -> str:
    text = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" font-family="sans-serif">'
        f'<rect width="{width:g}" height="{height:g}" fill="{GROUND}"/>{"".join(drawn)}</svg>'
    )
    for light in (INK, GROUND, GREY, FAINT) if dark else ():
        text = text.replace(f'"{light}"', f'"{on_dark(light)}"')
    return text
