"""The signatures of all effects at one point: the change of the residual by a small amount, for every shape tried."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from workbench.diagnose.hypotheses.problem import Problem
from workbench.effects import Effect, Ranged, ranges_of
from workbench.kinds import kind_of
from workbench.run import Array

PLACES_TRIED = 24  # along what the runs have passed
WAVES_TRIED = 120  # along the way
APART = 0.4  # of a wave over the whole way, from one tried to the next
SHAPES_TRIED = 4  # of a shape that says nothing else


@dataclass(frozen=True)
class Atom:
    """An effect at one shape. columns: (samples, k), for one scale of each amount (two of a wave; of each run).

    at: symbol -> value of the shapes. amounts: the ranges of the columns; scale: their amount. signed: whether a
    column may be taken negatively.
    """

    effect: Effect
    at: Mapping[str, float]
    columns: Array
    amounts: tuple[Ranged, ...]
    scale: tuple[float, ...]
    wave: Ranged | None

    @property
    def signed(self) -> bool:
        return self.wave is not None or all(r.lowest < _off(r) for r in self.amounts)


def _quadrature(
    base: Mapping[str, float | tuple[float, ...]], r: Ranged, wave: Ranged, angle: float
) -> dict[str, float]:
    """One start amount of a wave at an angle, added to the amount that the base has as its trace."""
    size, phase = _around(base, r), base.get(wave.symbol, 0.0)
    held = size * complex(math.cos(phase), math.sin(phase)) if isinstance(phase, float) else 0.0
    total = held + (r.start - _off(r)) * complex(math.cos(angle), math.sin(angle))
    return {r.symbol: abs(total), wave.symbol: math.atan2(total.imag, total.real) % (2.0 * math.pi)}


def _around(base: Mapping[str, float | tuple[float, ...]], r: Ranged) -> float:
    """The value of an amount without its effect: where it vanishes, or the amount that the base has as its trace."""
    value = base.get(r.symbol, _off(r))
    return value if isinstance(value, float) else _off(r)


def _off(r: Ranged) -> float:
    assert r.vanishes_at is not None
    return r.vanishes_at


def atoms(
    problem: Problem,
    effects: Iterable[Effect],
    base: Mapping[str, float | tuple[float, ...]],
    shapes_of: Mapping[str, Sequence[Mapping[str, float]]] | None = None,
) -> list[Atom]:
    """Every effect's signatures around the setting `base`. shapes_of: an effect's shapes, None to try all.

    Where blows come again, an amount that has `tries` starts from each of them: a play shows at its own share only.
    """
    planned: list[tuple[Effect, dict[str, float], tuple[Ranged, ...], Ranged | None, list[dict[str, float]]]] = []
    for effect in effects:
        ranges = ranges_of(effect, problem.machine, problem.runs)
        amounts = tuple(r for r in ranges if r.vanishes_at is not None)
        phases = [r for r in ranges if r.scan == "phase"]
        wave = phases[0] if phases and len(amounts) == 1 else None
        shapes = [r for r in ranges if r.vanishes_at is None and r is not wave]
        if shapes_of is not None and effect.id in shapes_of:
            points = [dict(at) for at in shapes_of[effect.id]]
        else:
            symbols = [r.symbol for r in shapes]
            tried = product(*(_tried(problem, r) for r in shapes))
            points = [dict(zip(symbols, point, strict=True)) for point in tried]
        starts = [amounts]
        if problem.struck and len(amounts) == 1 and amounts[0].tries:
            starts = [(replace(amounts[0], start=start),) for start in amounts[0].tries]
        for at, amounts in product(points, starts):
            lanes: list[dict[str, float]] = []
            for r in amounts:
                amount = {x.symbol: _around(base, x) + (x.start - _off(x) if x is r else 0.0) for x in amounts}
                if wave is None:
                    lanes.append({**at, **amount})
                else:
                    lanes += [{**at, **_quadrature(base, r, wave, angle)} for angle in (0.0, 0.5 * math.pi)]
            planned.append((effect, at, amounts, wave, lanes))
    settings = [{**base, **lane} for *_, lanes in planned for lane in lanes]
    if not settings:
        return []
    _, change = problem.differences(base, settings)
    signatures, row = [], 0
    for effect, at, amounts, wave, lanes in planned:
        columns = -change[row : row + len(lanes)].T  # what the prediction gains
        row += len(lanes)
        scale = tuple(r.start - _off(r) for r in amounts)
        if wave is not None and wave.per_run:
            columns = np.concatenate(
                [np.where((problem.run_of_row == j)[:, None], columns, 0.0) for j in range(len(problem.runs))], axis=1
            )
        signatures.append(Atom(effect, at, columns, amounts, scale, wave))
    return signatures


def _tried(problem: Problem, r: Ranged) -> Sequence[float]:
    if r.tries:
        return r.tries
    if r.scan in ("position", "drum_angle"):
        low, high = _visited(problem, r.scan)
        margin = 0.02 * (high - low)
        return [float(x) for x in np.linspace(low + margin, high - margin, PLACES_TRIED)]
    if r.scan == "frequency":
        longest = max(run.duration_s for run in problem.runs)
        count = max(2, math.ceil((r.highest - r.lowest) * longest / 2.5))
        return [float(x) for x in np.linspace(r.lowest, min(r.highest, 2.0 * math.pi * problem.band_hz), count)]
    if r.scan == "waves":
        low, high = _visited(problem, "position")
        # What passes faster than the band is not seen at the speed that the runs mostly have.
        most = problem.band_hz / max(_typical_speed(problem), 1e-300)
        count = min(max(2, math.ceil((min(r.highest, most) - r.lowest) * (high - low) / APART)), WAVES_TRIED)
        return [float(x) for x in np.linspace(r.lowest, min(r.highest, max(most, 2.0 * r.lowest)), count)]
    low = max(r.lowest, 1e-6 * r.highest)
    return [float(x) for x in np.geomspace(low, r.highest, SHAPES_TRIED + 2)[1:-1]] if r.highest > 0 else [r.start]


def _typical_speed(problem: Problem) -> float:
    """The lower quartile of the speeds that the runs move at."""
    motions = zip(problem.bench.motions, problem.rows, strict=True)
    return float(np.quantile(np.abs(np.concatenate([motion.speed[rows] for motion, rows in motions])), 0.25))


def _visited(problem: Problem, scan: str) -> tuple[float, float]:
    """The range of heights, or of drum angles, that the runs have passed."""
    kind = kind_of(problem.machine)
    sizes = kind.sizes(problem.machine, problem.runs)
    spans = []
    for run, motion in zip(problem.bench.runs, problem.bench.motions, strict=True):
        place = kind.place_of(problem.machine, run.start_position_m, motion.position)
        spans.append(place if scan == "position" else place * sizes.drum_angle / sizes.length)
    every = np.concatenate(spans)
    return float(np.min(every)), float(np.max(every))
