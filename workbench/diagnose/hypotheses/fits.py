"""The fits of one campaign: what one more effect promises beside a fit, linearly, and the fit that begins there.

What was fitted is kept; a fit that breaks down becomes a row of the report. Which hypotheses are fitted, and in which
order, is the search's (`search`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import takewhile
from typing import Any

import numpy as np

from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.diagnose.hypotheses import settings
from workbench.diagnose.hypotheses.evidence import beyond, beyond_model_error, cost, discounted, nested, score_of
from workbench.diagnose.hypotheses.fit import BREAKDOWNS, Fitted, fit_hypothesis, parameters_of, parts_of
from workbench.diagnose.hypotheses.free_parameters import (
    LOG_TIMING,
    FreeParameter,
    Names,
    Scalar,
    base_parameters,
    bounds_of,
    nuisance_parameters,
    setting_of,
)
from workbench.diagnose.hypotheses.problem import Problem, rms
from workbench.diagnose.hypotheses.signatures import Projection, Signature, signatures_of, start_of, stepped_aside
from workbench.diagnose.progress import Progress, Stage, Task, Tell
from workbench.effects import Effect, Ranged, ranges_of

FIRST_ROUND = 6  # evaluations each, before the field is narrowed
LAST_ROUND = 40
STRAINED = 2.0  # standard deviations of a nuisance amount
BEGUN = 0.2  # standard deviations of a nuisance amount that keeps a state, where the base fit begins
ASIDE = (1.0, 0.3, 0.0)  # of the way that a fit's own parameters step aside
SHAPES_KEPT = 3  # signatures of an effect that a pair is tried with
SHAPES_AGAIN = 6  # of an effect, simulated anew where another point is linearised


@dataclass(frozen=True)
class Promise:
    """The linear estimate for one effect at its best shape. gain: the fall of the objective, `data` of it in the
    residual. evidence: the gain less the cost of the parameters."""

    gain: float
    data: float
    evidence: float
    signature: Signature
    amounts: Array


class Fits:
    """One campaign's fits, by the names of their effects. base: the base parameters, which every fit has first."""

    def __init__(
        self,
        problem: Problem,
        effects: Iterable[Effect],
        tell: Tell | None = None,
        rivals: Iterable[Effect] = (),
        base: Mapping[str, Scalar] | None = None,
        own: Fitted | None = None,
    ) -> None:
        """rivals: unlisted effects that are fitted alone too, so that no pair is named in the place of one of them.

        base: the base parameters, None for all that have a tolerance. own: the fit of the machine's own effects, whose
        parameters are free in every fit, as the base parameters are.
        """
        self.problem = problem if own is None else problem.with_own(own.effects)
        taken = self.problem.own
        self.effects = {effect.id: effect for effect in effects if effect.id not in taken}
        self.rivals = {effect.id: effect for effect in rivals if effect.id not in (*taken, *self.effects)}
        self.base = dict(base_parameters(problem.machine, problem.logged) if base is None else base)
        self.nuisances = nuisance_parameters(problem.machine, problem.runs)
        self.held: list[FreeParameter] = [*self.base.values(), *self.nuisances.values()]
        self.held += own.free[len(self.held) :] if own is not None else ()
        self.count = sum(parameter.size for parameter in self.held)
        self._tell = tell or (lambda progress: None)
        self.fits: dict[Names, Fitted] = {}
        self.linear: dict[Names, float] = {}
        self.failures: dict[Names, str] = {}
        self._fitted: dict[Any, Fitted] = {}  # by problem, hypothesis and start
        self._promises: dict[tuple[Problem, Fitted], Iterable[Promise]] = {}
        self.scanned: Sequence[Signature] = ()
        self._base: Fitted | None = None
        self._begun: tuple[Fitted, Sequence[Signature]] | None = None  # within the tolerances, and the signatures there
        self._still: dict[Names, Fitted] = {}  # with a play, that no step serves
        self._offered: dict[Any, list[Array]] = {}  # by problem and hypothesis: friction that it was tried with
        self.begin = own.z if own is not None else None  # z of the base fit, where another search has found it
        self.found: Mapping[Names, Fitted] = {}  # fits of that search

    def base_fit(self) -> Fitted:
        """The fit of the base parameters alone, without an effect."""
        if self._base is None:
            self._tell(Progress(Stage.SEARCH, Task.BASE))
            fits = list[Fitted]()
            for z in self._starts():
                with suppress(*BREAKDOWNS):
                    fits.append(self._fit((), self.held, z))
            if not fits and self.begin is not None:
                self.begin = None  # beside what another search has found the simulation may break down
                return self.base_fit()
            if not fits:
                problem = "the fit breaks down, its numbers are not finite; is a value of machine.yaml in another unit?"
                raise InputError(problem)
            self._base = min(fits, key=lambda fit: fit.objective)
            for z in self._late_starts(self._base):
                with suppress(*BREAKDOWNS):
                    self._base = min(self._base, self._fit((), self.held, z), key=lambda fit: fit.objective)
        return self._base

    def _late_starts(self, fit: Fitted) -> list[Array]:
        """z with a motion that is logged late by each delay that is tried, where a fit leaves more than HALF of the
        input, rms: a delay longer than the motion's pulses has a minimum of its own."""
        problem = self.problem
        measured = np.concatenate([u[at] for u, at in zip(problem.bench.measured, problem.rows, strict=True)])
        left = rms(fit.residual[: problem.inputs])
        if LOG_TIMING not in self.base or left < settings.HALF * float(np.std(measured)):
            return []
        (delay,) = self._ranges(problem.effect("speed_delay"))
        starts = [fit.z.copy() for _ in delay.tries]
        for z, late_s in zip(starts, delay.tries, strict=True):
            z[self._place_of(self.base[LOG_TIMING])] = late_s / self.base[LOG_TIMING].scale
        return starts

    def _starts(self) -> list[Array]:
        """z where the base fit begins: nominal or as another search has found it, with a little of each nuisance that
        keeps a state, and with none. Such a one has minima of its own, and at exactly zero it may show nothing."""
        without, little = np.zeros(self.count), np.zeros(self.count)
        if self.begin is not None:
            without, little = self.begin.copy(), self.begin.copy()
        states = [one for key, one in self.nuisances.items() if self.problem.effect(key.partition(".")[0]).memory]
        for parameter in states:
            without[self._place_of(parameter)] = 0.0
            if self.begin is None:
                little[self._place_of(parameter)] = BEGUN * np.array(parameter.prior_std)
        return [little, without] if states else [little]

    def _place_of(self, wanted: FreeParameter) -> slice:
        """The slice of z that belongs to a base or nuisance parameter, the same in every fit."""
        before = [parameter.size for parameter in takewhile(lambda parameter: parameter is not wanted, self.held)]
        return slice(sum(before), sum(before) + wanted.size)

    def _ranges(self, effect: Effect) -> tuple[Ranged, ...]:
        return ranges_of(effect, self.problem.machine, self.problem.runs)

    def _new_to(self, names: Names, effect: str) -> bool:
        """Whether an effect is none of a hypothesis, nor the same law as one of it, freer or simpler."""
        return not any(effect == name or nested(effect, name, self.problem.active.kind) for name in names)

    def _strained(self, base: Fitted) -> dict[str, float]:
        """The effects whose nuisance amount the base fit puts far off its tolerance, and by how much chi^2: one of them
        may be the cause."""
        strained: dict[str, float] = {}
        for key, parameter in self.nuisances.items():
            off = np.abs(base.z[self._place_of(parameter)]) / np.array(parameter.prior_std)
            if not parameter.logarithmic and np.any(off > STRAINED):
                name = key.partition(".")[0]
                strained[name] = strained.get(name, 0.0) + float(np.sum(off**2))
        return strained

    def _signatures(self, effects: Sequence[Effect], at: Fitted) -> list[Signature]:
        """The signatures of all effects that can be simulated. A failed simulation becomes a row of the report.

        The first call tries every shape of every effect. Later calls try only the most promising shapes of the first.
        """
        try:
            signatures = signatures_of(self.problem, effects, at.setting, self._likely(effects, at))
        except BREAKDOWNS as error:
            if len(effects) == 1:
                self.failures[(effects[0].id,)] = f"{type(error).__name__}: {error}"
                return []
            signatures = [signature for effect in effects for signature in self._signatures([effect], at)]
        broken = {signature.effect.id for signature in signatures if not np.all(np.isfinite(signature.columns))}
        self.failures |= {(name,): "the simulation breaks down at the values tried first" for name in broken}
        return [signature for signature in signatures if signature.effect.id not in broken]

    def _likely(self, effects: Sequence[Effect], at: Fitted) -> dict[str, list[Mapping[str, float]]] | None:
        """Effect -> its most promising shapes at a point, by the signatures already known. None without signatures."""
        wanted = {effect.id for effect in effects}
        gains: dict[str, list[tuple[float, Mapping[str, float]]]] = {}
        again = [signature for signature in self.scanned if signature.effect.id in wanted]
        found = Projection.of(self.problem, at).gains(again) if again else []
        for signature, (data, prior, _) in zip(again, found, strict=True):
            gains.setdefault(signature.effect.id, []).append((data + prior, signature.at))
        best = {name: sorted(shapes, key=lambda q: -q[0])[:SHAPES_AGAIN] for name, shapes in gains.items()}
        return {name: [at for _, at in shapes] for name, shapes in best.items()} or None

    def _promised(self, at: Fitted, signatures: Sequence[Signature]) -> dict[str, Promise]:
        """Effect -> its best shape, linearly: of the SHAPES_KEPT best the one that explains most beyond the model error
        that stays beside it."""
        by_effect: dict[str, list[Promise]] = {}
        gains = Projection.of(self.problem, at).gains(signatures)
        for signature, (data, prior, amounts) in zip(signatures, gains, strict=True):
            size = signature.columns.shape[1] + len(signature.at)
            promise = Promise(data + prior, data, data + prior - cost(self.problem, size), signature, amounts)
            by_effect.setdefault(signature.effect.id, []).append(promise)
        best: dict[str, Promise] = {}
        for name, promises in by_effect.items():
            kept = sorted(promises, key=lambda promise: -promise.evidence)[:SHAPES_KEPT]
            best[name] = kept[0] if len(kept) == 1 else max(kept, key=lambda promise: self._beyond(at, promise))
        return best

    def _beyond(self, at: Fitted, promise: Promise) -> float:
        """What a promised effect adds to the likelihood of a fit, less what may be model error."""
        left = self._beside(at, promise)
        if not np.all(np.isfinite(left)):
            return -math.inf
        errors = self.problem.errors
        value, sizes = errors.likeliest(left)
        data = errors.likeliest(at.residual)[0] - value
        return discounted(self.problem, (promise.signature.effect.id,), data, at.residual, left, sizes, not at.effects)

    def _worth(self, at: Fitted, promise: Promise, least: float = 0.0) -> float:
        """The evidence that one more effect adds to a fit by its linear estimate, less what may be model error: what
        relieves the tolerances counts beside effects that take much of a remainder. least: the gain that the fit's
        inexact law alone could give."""
        if promise.evidence <= 0.0:
            return promise.evidence
        return promise.evidence - promise.data + beyond(self._beyond(at, promise), least)

    def _beside(self, at: Fitted, promise: Promise) -> Array:
        """(samples,) what a fit leaves beside a promised effect, its own parameters refitted linearly; not finite where
        the simulation breaks down at the effect's values."""
        taken = promise.signature.columns @ promise.amounts
        if not (np.all(np.isfinite(taken)) and np.all(np.isfinite(at.jacobian))):
            return np.full(len(taken), np.nan)
        z = self._aside(at, taken, promise.signature)
        return at.residual - taken + at.jacobian @ (z - at.z)

    def _fit_with(self, at: Fitted, *promises: Promise) -> Fitted:
        free, start, names = list(at.free), list[float](), at.effects
        for promise in promises:
            more, z = start_of(self.problem, promise.signature, promise.amounts)
            free, start, names = [*free, *more], [*start, *z], (*names, promise.signature.effect.id)
        taken = np.sum([promise.signature.columns @ promise.amounts for promise in promises], axis=0)
        beside = self._aside(at, taken, *(promise.signature for promise in promises))
        return self._fit_from(names, free, at.z, beside, start)

    def _fit_from(
        self, names: Names, free: Sequence[FreeParameter], at: Array, beside: Array, start: Sequence[float]
    ) -> Fitted:
        """A fit started with its base parameters moved to `beside`, or part of the way there if that fits better: the
        linear step may be too long."""
        ways = [np.concatenate([at + part * (beside - at), start]) for part in ASIDE]
        white = self.problem.errors.whiten(self.problem.residuals([setting_of(free, z) for z in ways]).T)
        std = bounds_of(free)[2]
        left = np.sum(white**2, axis=0) + np.array([np.sum((z / std) ** 2) for z in ways])
        z = ways[int(np.argmin(np.where(np.isfinite(left), left, np.inf)))]
        return self._fit(names, free, z, FIRST_ROUND)

    def _without(self, fit: Fitted, kept: Names) -> Fitted:
        """A fit with only the effects `kept` in it, from where it is: its own parameters take up what they can of the
        others' parts."""
        out = tuple(name for name in fit.effects if name not in kept)
        free = (*fit.free[: len(self.held)], *parameters_of(fit, kept, self.count)[0])
        stays = np.repeat([one in free for one in fit.free], [one.size for one in fit.free])
        at = replace(fit, effects=kept, free=free, z=fit.z[stays], jacobian=fit.jacobian[:, stays])
        beside = stepped_aside(self.problem, at, -parts_of(self.problem, fit, [out])[0])
        return self._fit_from(kept, free, at.z, beside, [])

    def _aside(self, at: Fitted, taken: Array, *signatures: Signature) -> Array:
        """z of the fit's own parameters, refitted linearly after effects have taken `taken`, (samples,), off it."""
        delay = self.problem.late in {r.symbol for signature in signatures for r in signature.amounts}
        return stepped_aside(self.problem, at, taken, delay)

    def _stepped(self, fit: Fitted, z: Array) -> float:
        """The objective of a fit's hypothesis after one linear step from z, by the fit's own slopes and without bounds;
        infinite where the simulation breaks down."""
        lowest, highest, std = bounds_of(fit.free)
        z = np.clip(z, lowest, highest)
        residual = self.problem.residuals([setting_of(fit.free, z)])[0]
        rows = self.problem.errors.whiten(np.column_stack([fit.jacobian, residual]))
        if not np.all(np.isfinite(rows)):
            return math.inf
        left = np.concatenate([rows[:, -1], z / std])
        slopes = np.vstack([rows[:, :-1], np.diag(1.0 / std)])
        step = np.linalg.lstsq(slopes.T @ slopes, -slopes.T @ left, rcond=1e-12)[0]
        return float(left @ left + step @ (slopes.T @ left))

    def _again(self, fit: Fitted) -> Fitted:
        return self._fit(fit.effects, fit.free, fit.z, known=fit.jacobian)

    def _fit(
        self, names: Names, free: Sequence[FreeParameter], z: Array, most: int = LAST_ROUND, known: Array | None = None
    ) -> Fitted:
        """The fit of a hypothesis from a start. What was fitted once is kept: each pass asks for some of it again."""
        asked = (self.problem, names, tuple(free), z.tobytes(), most, known is None)
        if asked not in self._fitted:
            # What counts is refitted at every sample; against the base fit all others are held.
            roughly = len(names) > 0 and self.problem.thin and not self.problem.fine
            self._fitted[asked] = fit_hypothesis(self.problem, names, free, z, most, self.count, known, roughly)
        return self._fitted[asked]

    def _try(self, names: Names, fit: Callable[[], Fitted]) -> None:
        """Run one fit. A failed candidate becomes a row of the report and does not end the search."""
        try:
            fitted = fit()
        except BREAKDOWNS as error:
            self.failures[names] = f"{type(error).__name__}: {error}"
            return
        if not (np.isfinite(fitted.objective) and np.all(np.isfinite(fitted.jacobian))):
            self.failures[names] = "the simulation breaks down at these values"
        elif names not in self.fits or self._better(fitted, self.fits[names]):
            self.fits[names] = fitted

    def _better(self, one: Fitted, other: Fitted) -> bool:
        """Of two fits of one hypothesis, by what each explains beyond the model error that stays beside it, and by the
        objective where neither does: a fine ripple of the machine's own may fit better than the large one that is the
        cause, at sizes of the model error that were found without it."""
        base = self.base_fit()
        none = score_of(self.problem, base)

        def worth(fit: Fitted) -> tuple[float, float]:
            score = score_of(self.problem, fit)
            gain = beyond_model_error(self.problem, base, fit, none.value - score.value, score.sizes)
            return max(gain, 0.0), -fit.objective

        return worth(one) > worth(other)
