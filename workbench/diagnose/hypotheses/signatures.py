"""Signatures: the change of the residual by a small amount of an effect, for every shape tried; and what a linear fit
of them promises, with everything projected out that base parameters could explain."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.fit import Fitted, is_timing, others_of, parameters_of, parts_of
from workbench.diagnose.hypotheses.free_parameters import (
    FreeParameter,
    Scalar,
    Setting,
    bounds_of,
    effect_parameters,
    setting_of,
)
from workbench.diagnose.hypotheses.problem import STEP, Problem
from workbench.effects import Effect, Ranged, ranges_of
from workbench.identify.fit import bounded
from workbench.machines import kind_of
from workbench.simulate.model_error import ErrorModel
from workbench.simulate.motion import PLAY

PLACES_TRIED = 24  # along what the runs have passed
WAVES_TRIED = 120  # along the way
WAVES_WEIGHED = 6000  # along the way, of which the residual's loudest are tried
ORDERS_TRIED = 6  # of a turn, the residual's loudest, beside those that are common
APART = 0.4  # of a wave over the whole way, from one tried to the next
SHAPES_TRIED = 4  # of a shape that says nothing else
SIZES = (0.2, 0.07, 0.025, 0.008)  # of the steps of a pattern search: of a value, or of LEAST of its scale if more
LEAST = 0.1
AGAIN = 2  # steps of one size
BESIDE, WAVES_BESIDE = 0.3, 241  # of a wave that was found, each way: others that are tried, and how many


@dataclass(frozen=True)
class Signature:
    """An effect at one shape. columns: (samples, k), for one scale of each amount (two of a wave; of each run).

    at: symbol -> value of the shapes. amounts: the ranges of the columns; scale: their amount.
    """

    effect: Effect
    at: Mapping[str, float]
    columns: Array
    amounts: tuple[Ranged, ...]
    scale: tuple[float, ...]
    wave: Ranged | None


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


def signatures_of(
    problem: Problem,
    effects: Iterable[Effect],
    base: Setting,
    shapes_of: Mapping[str, Sequence[Mapping[str, float]]] | None = None,
) -> list[Signature]:
    """Every effect's signatures around the setting `base`. shapes_of: an effect's shapes, None to try all.

    An amount that has `tries` starts from each of them: a long delay does not look like a short one. That of a play
    does where impacts come again. Beside a play what rubs is tried as little as base values are for their derivatives:
    more of it moves the instants at which teeth meet, and no base value takes that back.
    """
    played = kind_of(problem.machine).bridged_impacts and any(symbol.startswith(f"{PLAY}__") for symbol in base)
    planned: list[tuple[Effect, dict[str, float], tuple[Ranged, ...], Ranged | None, list[dict[str, float]]]] = []
    for effect in effects:
        ranges = ranges_of(effect, problem.machine, problem.runs)
        amounts = tuple(r for r in ranges if r.vanishes_at is not None)
        if played and effect.dissipative:
            amounts = tuple(replace(r, start=_off(r) + STEP * (r.start - _off(r))) for r in amounts)
        phases = [r for r in ranges if r.scan == "phase"]
        wave = phases[0] if phases and len(amounts) == 1 else None
        shapes = [r for r in ranges if r.vanishes_at is None and r is not wave]
        if shapes_of is not None and effect.id in shapes_of:
            points = [dict(at) for at in shapes_of[effect.id]]
        else:
            points = [dict(at) for at in product(*(product([r.symbol], _tried(problem, r, base)) for r in shapes))]
        starts = [amounts]
        if (problem.struck or effect.id != PLAY) and len(amounts) == 1 and amounts[0].tries:
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
    change = problem.linear(base, settings)
    signatures, row = [], 0
    for effect, at, amounts, wave, lanes in planned:
        columns = -change[row : row + len(lanes)].T  # what the prediction gains
        row += len(lanes)
        scale = tuple(r.start - _off(r) for r in amounts)
        if wave is not None and wave.per_run:
            columns = np.concatenate(
                [np.where((problem.run_of_row == j)[:, None], columns, 0.0) for j in range(len(problem.runs))], axis=1
            )
        signatures.append(Signature(effect, at, columns, amounts, scale, wave))
    return signatures


def _tried(problem: Problem, r: Ranged, base: Setting) -> Sequence[float]:
    if r.scan == "order" and kind_of(problem.machine).moved.placed_by_log:  # and the loudest, weighed as the data are
        angle = np.concatenate([m.position[at] for m, at in zip(problem.bench.motions, problem.rows, strict=True)])
        most, turns = max(r.tries), float(np.ptp(angle)) / (2.0 * math.pi)
        fine = np.linspace(r.lowest, most, min(max(2, math.ceil((most - r.lowest) * turns / APART)), WAVES_WEIGHED))
        weighed = problem.residuals([base])[0][: problem.inputs] / problem.errors.white[: problem.inputs] ** 2
        strongest = fine[loudest(weighed, angle / (2.0 * math.pi), fine, ORDERS_TRIED)]
        return [*r.tries, *(float(order) for order in strongest)]
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
    if r.scan in ("waves", "period"):
        low, high = _visited(problem, "position")
        least, most = (r.lowest, r.highest) if r.scan == "waves" else (1.0 / r.highest, 1.0 / r.lowest)
        # What passes faster than the band is not seen at the speed that the runs mostly have: three in four of theirs.
        speed = float(np.quantile(np.abs(_speeds(problem)), 0.25))
        most = min(most, max(problem.band_hz / max(speed, 1e-300), 2.0 * least))
        count = max(2, math.ceil((most - least) * (high - low) / APART))
        fine = np.linspace(least, most, min(2 * count, WAVES_WEIGHED))
        place = np.concatenate([at[rows] for at, rows in zip(_places(problem), problem.rows, strict=True)])
        left = problem.residuals([base])[0][: problem.inputs]
        if r.scan == "period":  # of friction: it goes against the motion
            against = left * np.sign(_speeds(problem))
            return list(1.0 / fine[loudest(against - np.mean(against), place, fine, ORDERS_TRIED)])
        evenly = np.linspace(least, most, min(count, WAVES_TRIED))
        if count <= WAVES_TRIED:
            return list(evenly)
        return list(np.union1d(fine[loudest(left, place, fine, WAVES_TRIED // 2)], evenly[::2]))
    low = max(r.lowest, 1e-6 * r.highest)
    return [float(x) for x in np.geomspace(low, r.highest, SHAPES_TRIED + 2)[1:-1]] if r.highest > 0 else [r.start]


def loudest(residual: Array, place: Array, waves: Array, count: int) -> np.ndarray:
    """Of (m,) waves per unit of the way, evenly apart, the indices of the `count` strongest peaks of the residual's
    spectrum over the place, both (n,)
    (N. Lomb, Astrophysics and Space Science 39, 1976, without his offset in time)."""
    turn = np.exp(-2j * math.pi * (waves[1] - waves[0]) * place)
    now = residual * np.exp(-2j * math.pi * waves[0] * place)
    power = np.empty(len(waves))
    for k in range(len(waves)):
        power[k] = abs(np.sum(now))
        now *= turn
    peaks = np.flatnonzero((power >= np.roll(power, 1)) & (power >= np.roll(power, -1)))
    return np.sort(peaks[np.argsort(-power[peaks])[:count]])


def _places(problem: Problem) -> list[Array]:
    """Each run's place at every sample of its log."""
    kind = kind_of(problem.machine)
    runs = zip(problem.bench.runs, problem.bench.motions, strict=True)
    return [kind.place_of(problem.machine, run.start_position_m, motion.position) for run, motion in runs]


def _speeds(problem: Problem) -> Array:
    """(inputs,) of the driven coordinate."""
    return np.concatenate([m.speed[at] for m, at in zip(problem.bench.motions, problem.rows, strict=True)])


def _visited(problem: Problem, scan: str) -> tuple[float, float]:
    """The range of heights, or of drum angles, that the runs have passed."""
    sizes = kind_of(problem.machine).sizes(problem.machine, problem.runs)
    every = np.concatenate(_places(problem)) * (1.0 if scan == "position" else sizes.drum_angle / sizes.length)
    return float(np.min(every)), float(np.max(every))


@dataclass(frozen=True)
class Projection:
    """Residual and signatures with the part that the base parameters can explain projected out."""

    errors: ErrorModel
    rows: Array  # orthonormal columns of the whitened, augmented base Jacobian
    residual: Array
    priors: int

    @staticmethod
    def of(problem: Problem, base: Fitted) -> Projection:
        _, _, std = bounds_of(base.free)
        white = problem.errors.whiten(np.column_stack([base.jacobian, base.residual]))
        q, _ = np.linalg.qr(np.vstack([white[:, :-1], np.diag(1.0 / std)]))
        residual = np.concatenate([white[:, -1], base.z / std])
        return Projection(problem.errors, q, residual - q @ (q.T @ residual), len(std))

    def clean(self, columns: Array) -> Array:
        """(samples, k) signatures -> (samples + priors, k), whitened, the base taken out."""
        a = np.vstack([self.errors.whiten(columns), np.zeros((self.priors, columns.shape[1]))])
        return a - self.rows @ (self.rows.T @ a)

    def gains(self, signatures: Sequence[Signature]) -> list[tuple[float, float, Array]]:
        """`linear_gain` of each effect at one shape; all are cleaned together."""
        if not signatures:
            return []
        every = self.clean(np.hstack([one.columns for one in signatures]))
        parts = np.split(every, np.cumsum([one.columns.shape[1] for one in signatures[:-1]]), axis=1)
        return [
            linear_gain(columns, self.residual, columns_signed(one), self.priors)
            for columns, one in zip(parts, signatures, strict=True)
        ]


def linear_gain(columns: Array, residual: Array, signs: Sequence[bool], priors: int) -> tuple[float, float, Array]:
    """The largest fall of |residual|^2 by the columns: in the data, in the last `priors` rows; and their amounts.

    signs: which amounts may be negative.
    """
    gain, amounts = gain_of(columns.T @ columns, columns.T @ residual, signs)
    at = residual[-priors:]
    prior = float(np.sum(at**2 - (at - columns[-priors:] @ amounts) ** 2))
    return gain - prior, prior, amounts


def gain_of(gram: Array, pull: Array, signs: Sequence[bool]) -> tuple[float, Array]:
    """`linear_gain` by the columns' products with each other and with the residual: data and prior together."""
    if not len(pull):
        return 0.0, np.zeros(0)
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    amounts = _normal(gram, pull, scale)
    held = np.zeros(len(pull), dtype=bool)
    # What comes out negative and must not be is left out, one after the other: few columns have signs.
    while np.any(wrong := ~np.array(signs) & ~held & (amounts < 0.0)):
        held[int(np.argmin(np.where(wrong, amounts * scale, 0.0)))] = True
        free = np.flatnonzero(~held)
        amounts = np.zeros(len(pull))
        if len(free):
            amounts[free] = _normal(gram[np.ix_(free, free)], pull[free], scale[free])
    return float(2.0 * amounts @ pull - amounts @ gram @ amounts), amounts


def _normal(gram: Array, pull: Array, scale: Array) -> Array:
    """Least squares by the normal equations, each column on its own scale; nearly equal columns share the amount."""
    unit = gram / np.outer(scale, scale)
    unit[np.diag_indices_from(unit)] += 1e-9
    return np.asarray(np.linalg.solve(unit, pull / scale) / scale)


def start_of(problem: Problem, signature: Signature, amounts: Array) -> tuple[list[FreeParameter], list[float]]:
    """Knobs and z of an effect, from the amounts that a linear fit gave its signature."""
    effect = signature.effect
    ranges = ranges_of(effect, problem.machine, problem.runs)
    at: dict[str, float | tuple[float, ...]] = dict(signature.at)
    if signature.wave is not None:
        r, scale = signature.amounts[0], signature.scale[0]
        if signature.wave.per_run:
            pairs = amounts.reshape(-1, 2)
            size = float(np.sqrt(np.mean(np.sum(pairs**2, axis=1)))) * scale
            at[r.symbol] = min(max(size, 0.05 * r.scale), r.highest)
            at[signature.wave.symbol] = tuple(float(math.atan2(b, a)) for a, b in pairs)
        else:
            at[r.symbol] = min(float(np.hypot(*amounts)) * scale, r.highest)
            at[signature.wave.symbol] = math.atan2(amounts[1], amounts[0])
    else:
        for r, scale, amount in zip(signature.amounts, signature.scale, amounts, strict=True):
            assert r.vanishes_at is not None
            value = r.vanishes_at + scale * float(amount)
            at[r.symbol] = min(max(value, r.lowest), r.highest)
    return effect_parameters(effect, ranges, at)


def other_waves(problem: Problem, fit: Fitted, name: str, base: int) -> tuple[Array, list[Setting]]:
    """Waves that could stand in an effect's place: how likely each is, (k,), and its values; none of an effect that is
    no wave whose length is sought.

    A log shows a wave through a window: lengths of which one more or less fits on the way fit nearly as well, and what
    a machine leaves may choose among them, of which no slope at one tells. All else is refitted linearly. base: how
    many of the first z are the base parameters'.
    """
    effect, ranges = problem.effect(name), ranges_of(problem.effect(name), problem.machine, problem.runs)
    waves = [r for r in ranges if r.scan in ("order", "waves")]
    if not waves or waves[0].symbol not in fit.setting:  # on a short way one length alone is a wave
        return np.zeros(0), []
    rest = replace(others_of(fit, (name,), base), residual=fit.residual + parts_of(problem, fit, [(name,)])[0])
    off = {r.symbol: r.vanishes_at for r in ranges if r.vanishes_at is not None}
    tried = float(np.mean(fit.setting[waves[0].symbol])) * np.linspace(1.0 - BESIDE, 1.0 + BESIDE, WAVES_BESIDE)
    found = signatures_of(problem, [effect], {**fit.setting, **off}, {name: [{waves[0].symbol: at} for at in tried]})
    sound = [one for one in found if np.all(np.isfinite(one.columns))]  # beside some the simulation may break down
    gains = Projection.of(problem, rest).gains(sound)
    more = np.array([data + prior for data, prior, _ in gains]) / max(1.0, fit.chi2 / (problem.share * problem.samples))
    starts = [start_of(problem, one, amounts) for one, (_, _, amounts) in zip(sound, gains, strict=True)]
    likely = np.exp(0.5 * (more - np.max(more, initial=-np.inf)))
    return likely, [setting_of(free, np.array(z)) for free, z in starts]


def stepped_aside(problem: Problem, at: Fitted, taken: Array, delay: bool = False) -> Array:
    """z of a fit's own parameters, refitted linearly within their bounds after an effect has taken `taken`, (samples,),
    off the residual.

    Two nonlinear parameters stay fixed: the turn-over of friction, and the log's timing, since friction jumps between
    samples. delay: the effect is a delay itself, so the timing is refitted too.
    """
    lowest, highest, std = bounds_of(at.free)
    moved = np.array(
        [not (k.logarithmic or (is_timing(k) and not delay)) for k in at.free for _ in range(k.size)], dtype=bool
    )
    white = problem.errors.whiten(np.column_stack([at.jacobian[:, moved], at.residual - taken]))
    prior = np.column_stack([np.diag(1.0 / std[moved]), at.z[moved] / std[moved]])
    both = white.T @ white + prior.T @ prior
    z = at.z.copy()
    z[moved] += bounded(both[:-1, :-1], -both[:-1, -1], (lowest - at.z)[moved], (highest - at.z)[moved])
    return np.clip(z, lowest, highest)


def stepped(
    problem: Problem, fit: Fitted, name: str, base: int, also: Sequence[Setting] = (), everywhere: bool = False
) -> Array:
    """z of the best point found around a fit by a pattern search of an effect's values, all else refitted linearly
    beside each. also: from these values, where they are better; everywhere: from the best of what is tried first. base:
    how many of the first z are the base parameters'.

    The teeth of a play meet between two samples: a small change of its law moves no sample at all, a larger one several
    (R. Hooke, T. A. Jeeves, Direct search solution of numerical and statistical problems, J. ACM 8, 1961); what is
    linear follows along the valley (G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10, 1973).
    """
    own = [k for k in parameters_of(fit, (name,), base)[0] if isinstance(k, Scalar)]
    mine = np.repeat([k in own for k in fit.free], [k.size for k in fit.free])
    others = tuple(k for k in fit.free if k not in own)
    at = replace(fit, free=others, z=fit.z[~mine], jacobian=fit.jacobian[:, ~mine])
    beside, (lowest, highest, _) = Projection.of(problem, at), bounds_of(own)

    def best_of(tried: Sequence[Array]) -> tuple[float, Array, Array]:
        """What the best leaves; its values' z; what it takes off the residual."""
        z = np.tile(fit.z, (len(tried), 1))
        z[:, mine] = np.clip(tried, lowest, highest)
        change = problem.differences(fit.setting, [setting_of(fit.free, one) for one in z], fit.residual)[1]
        left = np.sum((beside.residual[:, None] + beside.clean(change.T)) ** 2, axis=0)
        k = int(np.argmin(np.where(np.isfinite(left), left, np.inf)))
        return float(left[k]), z[k, mine], -change[k]

    ranges = {r.symbol: r for r in ranges_of(problem.effect(name), problem.machine, problem.runs)}
    tries = [ranges[k.symbol].tries[:: 2 if k.amount else 1] for k in own] if everywhere else [()]
    points = [*product(*tries), *([float(np.mean(one[k.symbol])) for k in own] for one in also)]
    first = [np.array([k.z_of(x) for k, x in zip(own, point, strict=True)]) for point in points]
    best = best_of([fit.z[mine], *first])
    # Along each value, and along all at once.
    moves = [
        np.array(move) for move in product((-1.0, 0.0, 1.0), repeat=len(own)) if np.sum(np.abs(move)) in (1, len(own))
    ]
    for size in SIZES:
        for _ in range(AGAIN):
            reach = size * np.where([k.logarithmic for k in own], 1.0, np.maximum(np.abs(best[1]), LEAST))
            found = best_of([best[1] + move * reach for move in moves])
            if found[0] >= best[0]:
                break
            best = found
    if not np.any(best[1] != fit.z[mine]):
        return fit.z
    z = fit.z.copy()
    z[~mine], z[mine] = stepped_aside(problem, at, best[2]), best[1]
    return z


def columns_signed(signature: Signature) -> list[bool]:
    if signature.wave is not None:
        return [True] * signature.columns.shape[1]
    return [r.lowest < (r.vanishes_at or 0.0) for r in signature.amounts]
