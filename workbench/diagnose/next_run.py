"""The run that would decide between hypotheses that the campaign leaves open, and by how much."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from workbench.diagnose.base import LOAD_CELL_STD
from workbench.diagnose.fits import Fitted, Projection, columns_signed, linear_gain, start_of
from workbench.diagnose.knobs import TENSION_GAIN, Knob, PhaseOfEachRun, Setting, bounds_of, setting_of
from workbench.diagnose.planned import Planned, menu
from workbench.diagnose.problem import GROUP, SENSOR_KEYS, STEP, TENSION, TENSION_TRUST, Problem
from workbench.diagnose.records import Names, NextRun
from workbench.diagnose.score import LEAST
from workbench.diagnose.search import Found
from workbench.machine import Hoist
from workbench.run import Array
from workbench.simulate.driven import changed

APART = 3.0  # standard deviations: then a run decides
WORTH = 1.0  # more than now: less is not worth a run
RIVALS = 3  # that the leading hypothesis is held against
POSITION = "position_carriage_m"
POSITION_TRUST = 1e-4  # of the wire's length: a usual draw-wire encoder or laser


@dataclass(frozen=True)
class Line:
    """A hypothesis around its fit, linear in z, on the campaign or on one run of the menu.

    residual: (rows,) in standard deviations; jacobian: (rows, len(z)); own: (rows, k) what each run has of its own
    (a phase, a load cell's gain), own_hold: (k,) one over how far it may lie off. channel: (rows,) which signal.
    """

    residual: Array
    jacobian: Array
    own: Array
    own_hold: Array
    channel: np.ndarray
    share: float


@dataclass(frozen=True)
class Offer:
    """One entry of the menu: a run and what is logged beside the motors."""

    planned: Planned
    signals: tuple[str, ...]
    separation: float


def next_run(problem: Problem, found: Found, open_effects: Sequence[Fitted | str | Names]) -> NextRun | None:
    """The cheapest run that sets the first of the open hypotheses apart from the others, else the best.

    Of each run of the menu the hypotheses' predictions are compared after base parameters and effects were fitted
    anew to all data, as far as tolerances allow. What differs by less than LEAST of the noise counts for nothing.
    None where fewer than two are open.
    """
    fits = [fit for each in open_effects if (fit := _fit_of(problem, found, each)) is not None][: RIVALS + 1]
    if len(fits) < 2:
        return None
    planned = menu(problem)
    if not planned:
        return None
    campaign = [_on_campaign(problem, fit) for fit in fits]
    now = _apart(fits, campaign, None)
    ahead = Problem(problem.machine, [each.run for each in planned], problem.band_hz)
    trial = [_on_menu(problem, ahead, fit) for fit in fits]
    logged = tuple(s for s in (POSITION, TENSION) if all(s in run for run in problem.runs))
    offers: list[Offer] = []
    for signals in _choices(problem, logged):
        for k, each in enumerate(planned):
            lines = [of_run(k, signals) for of_run in trial]
            offers.append(Offer(each, signals, _apart(fits, campaign, lines)))
        if any(_decides(offer, now) for offer in offers):
            break
    best = choose(offers, now)
    return NextRun(
        _why(problem, fits, best, now), best.planned.payload_kg, best.planned.words, best.signals, best.separation, now
    )  # fmt: skip


def choose(offers: Sequence[Offer], now: float) -> Offer:
    """The cheapest offer that decides: few signals first, then a short run; else the one that sets most apart."""
    enough = [offer for offer in offers if _decides(offer, now)]
    if enough:
        return min(enough, key=lambda o: (len(o.signals), o.planned.duration_s, -o.separation))
    most = max(offer.separation for offer in offers)
    return min(
        (o for o in offers if o.separation >= 0.95 * most), key=lambda o: (len(o.signals), o.planned.duration_s)
    )  # fmt: skip


def _decides(offer: Offer, now: float) -> bool:
    return offer.separation > APART and offer.separation > now + WORTH


def _choices(problem: Problem, logged: tuple[str, ...]) -> list[tuple[str, ...]]:
    """What to log beside the motors, cheapest first; what is logged already stays."""
    if not isinstance(problem.machine, Hoist):
        return [()]
    every = [logged, *(tuple(sorted({*logged, more})) for more in (POSITION, TENSION))]
    return list(dict.fromkeys(every))


def _fit_of(problem: Problem, found: Found, each: Fitted | str | Names) -> Fitted | None:
    """The fit of a hypothesis; of what was not refitted, the linear one at its best shape."""
    if isinstance(each, Fitted):
        return each
    names = (each,) if isinstance(each, str) else tuple(each)
    if names in found.fits:
        return found.fits[names]
    if not names:
        return found.base
    if len(names) > 1:
        return None
    near = found.near
    projection = Projection.of(problem, near, near.sigma)
    options = []
    for atom in found.atoms:
        if atom.effect.id == names[0]:
            columns = projection.clean(atom.columns)
            gain = linear_gain(columns, projection.residual, columns_signed(atom), projection.priors)
            options.append((gain[0] + gain[1], atom, gain[2]))
    if not options:
        return None
    _, atom, amounts = max(options, key=lambda q: q[0])
    more, start = start_of(problem, atom, amounts)
    knobs, z = (*near.knobs, *more), np.concatenate([near.z, start])
    residual, jacobian = problem.evaluate(knobs, z)
    chi2 = problem.share / near.sigma**2 * float(residual @ residual)
    return Fitted(names, knobs, z, residual, jacobian, near.sigma, chi2, near.prior, 1, False)


def _on_campaign(problem: Problem, fit: Fitted) -> Line:
    rows = len(fit.residual)
    channel = np.where(np.arange(rows) < problem.inputs, 0, 1)
    nothing = np.zeros((rows, 0))
    return Line(fit.residual / fit.sigma, fit.jacobian / fit.sigma, nothing, np.zeros(0), channel, problem.share)


def _on_menu(problem: Problem, ahead: Problem, fit: Fitted) -> Callable[[int, tuple[str, ...]], Line]:
    """A hypothesis on any run of the menu, by its number and what is logged there."""
    steps = [fit.z, *(fit.z + STEP * row for row in np.eye(len(fit.z)))]
    settings: list[Setting] = [_of_one_run(setting_of(fit.knobs, z)) for z in steps]
    cell = TENSION_GAIN not in settings[0]
    if cell:  # a load cell that the campaign did not have: its gain is not known
        settings.append({**settings[0], TENSION_GAIN: 1.0 + STEP * LOAD_CELL_STD})
    base, change = ahead.differences(settings[0], settings[1:])
    heights: list[Array] = []
    phases = _phases(fit.knobs)

    def of_run(k: int, signals: tuple[str, ...]) -> Line:
        mine = np.flatnonzero(ahead.run_of_row == k)
        input_rows, tension_rows = mine[mine < ahead.inputs], mine[mine >= ahead.inputs]
        parts = [(base[input_rows], change[:, input_rows] / STEP, fit.sigma)]
        if TENSION in signals:
            noise = problem.tension_noise if problem.has_tension else _tension_noise(ahead, k)
            # The menu's tension stands on the scale of its own torque and load cell.
            unit = noise * ahead.noise / ahead.tension_noise
            parts.append((base[tension_rows], change[:, tension_rows] / STEP, unit))
        if POSITION in signals:
            if not heights:
                heights.extend(_heights(ahead, settings))
            machine = problem.machine
            assert isinstance(machine, Hoist)
            x = heights[k]
            parts.append((-x[0], -(x[1:] - x[0]) / STEP, POSITION_TRUST * machine.wire.segment_length_m))
        residual = np.concatenate([r / unit for r, _, unit in parts])
        slopes = np.concatenate([j / unit for _, j, unit in parts], axis=1).T
        channel = np.repeat(np.arange(len(parts)), [len(r) for r, _, _ in parts])
        jacobian, own, hold = slopes[:, : len(fit.z)].copy(), [], []
        for first, many in phases:  # a new run has a phase of its own
            own.append(jacobian[:, first].copy())
            hold.append(0.0)
            jacobian[:, first : first + many] = 0.0
        if cell:
            own.append(slopes[:, -1])
            hold.append(1.0)
        extra = np.stack(own, axis=1) if own else np.zeros((len(residual), 0))
        return Line(residual, jacobian, extra, np.array(hold), channel, ahead.share)

    return of_run


def _tension_noise(ahead: Problem, k: int) -> float:
    return TENSION_TRUST * float(np.mean(ahead.tension[k]))


def _heights(ahead: Problem, settings: Sequence[Setting]) -> list[Array]:
    """Of each run (settings, rows) the carriage's height above its first one, m."""
    out: list[list[Array]] = [[] for _ in ahead.runs]
    base = _values(ahead, settings[0])
    for k in range(1, len(settings), GROUP - 1):
        lanes = [base, *(_values(ahead, each) for each in settings[k : k + GROUP - 1])]
        predicted = ahead.bench.predict(lanes)
        for j, rows in enumerate(ahead.rows):
            x = [states[j][1][:, 1] for states in predicted]
            # All lanes of a group take the same steps: their differences are free of step-size noise.
            shift = [(each - each[0] - (x[0] - x[0][0]))[rows] for each in x[1:]]
            if k == 1:
                out[j].append((x[0] - x[0][0])[rows])
            out[j] += [out[j][0] + each for each in shift]
    return [np.stack(each) for each in out]


def _values(ahead: Problem, setting: Setting) -> list[SimpleNamespace]:
    plain = {s: float(v) for s, v in setting.items() if s not in SENSOR_KEYS and not isinstance(v, tuple)}
    return [changed(each, plain) for each in ahead.bench.base]


def _phases(knobs: Sequence[Knob]) -> list[tuple[int, int]]:
    """Where in z what is each run's own begins, and how many runs it has."""
    found, at = [], 0
    for knob in knobs:
        if isinstance(knob, PhaseOfEachRun):
            found.append((at, len(knob.start)))
        at += len(knob.lowest)
    return found


def _of_one_run(setting: Setting) -> dict[str, float | tuple[float, ...]]:
    return {symbol: value[0] if isinstance(value, tuple) else value for symbol, value in setting.items()}


def _apart(fits: Sequence[Fitted], campaign: Sequence[Line], more: Sequence[Line] | None) -> float:
    """Standard deviations between the first hypothesis and its nearest rival, whichever of the two is true."""
    least = math.inf
    for k in range(1, len(fits)):
        for true, rival in ((0, k), (k, 0)):
            lines = [(campaign[true], campaign[rival])]
            if more is not None:
                lines.append((more[true], more[rival]))
            least = min(least, separation(fits[true], fits[rival], lines))
    return least


def separation(true: Fitted, rival: Fitted, lines: Sequence[tuple[Line, Line]]) -> float:
    """How many standard deviations the rival stays off data that the true hypothesis makes, refitted to them."""
    _, _, std = bounds_of(rival.knobs)
    own = sum(line.own.shape[1] for _, line in lines)
    size, at = len(rival.z) + own, len(rival.z)
    matrix, target = [np.hstack([np.diag(1.0 / std), np.zeros((len(std), own))])], [-rival.z / std]
    blocks = []
    for mine, its in lines:
        weight = math.sqrt(its.share)
        a = np.zeros((len(its.residual), size))
        a[:, : len(rival.z)] = weight * its.jacobian
        k = its.own.shape[1]
        a[:, at : at + k] = weight * its.own
        hold = np.zeros((k, size))
        hold[:, at : at + k] = np.diag(its.own_hold)
        at += k
        blocks.append((a, -weight * (its.residual - mine.residual), its))
        matrix += [a, hold]
        target += [blocks[-1][1], np.zeros(k)]
    a, b = np.concatenate(matrix), np.concatenate(target)
    size_of = np.maximum(np.linalg.norm(a, axis=0), 1e-300)
    step = np.linalg.lstsq(a / size_of, b, rcond=1e-10)[0] / size_of
    total = float(np.sum(((rival.z + step[: len(rival.z)]) / std) ** 2)) - true.prior
    for part, wanted, line in blocks:
        left = (part @ step - wanted) ** 2
        for channel in np.unique(line.channel):
            rows = line.channel == channel
            total += max(float(left[rows].sum()) - LEAST**2 * line.share * int(rows.sum()), 0.0)
    return math.sqrt(max(total, 0.0))


def _why(problem: Problem, fits: Sequence[Fitted], best: Offer, now: float) -> str:
    names = [" with ".join(fit.effects) or "no effect" for fit in fits]
    rivals = names[1] if len(names) == 2 else f"{', '.join(names[1:-1])} and {names[-1]}"
    load = f"a run with {best.planned.payload_kg:g} kg" if isinstance(problem.machine, Hoist) else "a run"
    signals = f" and with {' and '.join(best.signals)} logged" if best.signals else ""
    begin = f"The campaign sets {names[0]} apart from {rivals} by {now:.1f} standard deviations"
    if now < 0.05:
        begin = f"The campaign does not set {names[0]} apart from {rivals}"
    if best.separation > APART:
        return f"{begin}; {load}, {best.planned.words}{signals}, would do so by {best.separation:.1f}."
    return (
        f"{begin}; no run on the menu decides. The best, {load}, {best.planned.words}{signals}, would set them apart "
        f"by {best.separation:.1f}: a closer tolerance is needed, such as a weighed load or a checked sensor."
    )
