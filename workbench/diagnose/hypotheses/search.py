"""The search: base, then every effect alone, then pairs around the best; each at its best values.

Shapes are tried linearly, on signatures; what looks worth it is refitted nonlinearly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, takewhile

import numpy as np

from workbench.diagnose.hypotheses.base import base_knobs, trace_knobs
from workbench.diagnose.hypotheses.fits import (
    Fitted,
    Projection,
    columns_signed,
    fit_knobs,
    linear_gain,
    start_of,
    stepped_aside,
)
from workbench.diagnose.hypotheses.knobs import LOG_TIMING, Knob, Value, bounds_of, effect_knobs, setting_of, within
from workbench.diagnose.hypotheses.merit import beyond, beyond_discrepancy, discounted, inexact
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.records import Names
from workbench.diagnose.hypotheses.scan import Atom, atoms
from workbench.diagnose.hypotheses.score import STEP, cost, score_of
from workbench.diagnose.progress import Progress, Stage, Task, Tell
from workbench.effects import Effect, Ranged, ranges_of
from workbench.run import Array

REFITTED = 8  # single effects that are refitted nonlinearly, the linearly best
FIRST_ROUND = 6  # evaluations each, before the field is narrowed
LAST_ROUND = 40
ALWAYS = 2  # effects refitted whatever they promise
HOPELESS = -10.0  # merit, linearly
EXTENDED_REFITTED = 6
LEADS = 0.4  # of the best single effect's gain
TOLERANCES = 3.0  # within which signatures are taken
TURNED = 1.5  # the same, of the logarithm of what nobody knows: how friction turns over
DROPPED = 1  # pairs
PAIR_IN_REACH = 0.9
STRAINED = 2.0  # standard deviations of a trace
STUCK = 0.5  # of the logarithm of how friction turns over: further apart lie different minima
IN_REACH = 0.3  # of the best gain: what is followed to its end
PARTNERS = 3  # of each leading effect, that are refitted with it
LEADERS = 3
TOO_SMALL = 1.5  # sizes of the discrepancy: what needs more is searched again with them
ASIDE = (1.0, 0.3, 0.0)  # of the way that a fit's own parameters step aside
SHAPES_KEPT = 3  # atoms of an effect that a pair is tried with
SHAPES_AGAIN = 6  # of an effect, simulated anew where another point is linearised

BREAKDOWNS = (ArithmeticError, ValueError, np.linalg.LinAlgError)  # of one candidate


@dataclass(frozen=True)
class Found:
    """base: no effect; near: the same with every base parameter within TOLERANCES. fits: names -> the best fit.

    linear: names -> what a linear fit promises, also for what was not refitted. failures: names -> why a fit broke
    down. atoms: the signatures at `near`. rivals: effects weighed alone that no answer may name.
    """

    problem: Problem
    base: Fitted
    near: Fitted
    fits: Mapping[Names, Fitted]
    linear: Mapping[Names, float]
    atoms: Sequence[Atom]
    failures: Mapping[Names, str] = field(default_factory=dict)
    rivals: frozenset[str] = frozenset()

    def gain(self, names: Names) -> float:
        """What the objective falls by, against no effect."""
        return self.base.objective - self.fits[names].objective


@dataclass(frozen=True)
class Promise:
    """What one effect takes off the objective at its best shape, linearly, `data` of it off the data; and what that is
    worth."""

    gain: float
    data: float
    merit: float
    atom: Atom
    amounts: Array


def searched(
    problem: Problem,
    effects: Sequence[Effect],
    most_effects: int = 2,
    tell: Tell | None = None,
    rivals: Sequence[Effect] = (),
    base: Mapping[str, Value] | None = None,
) -> Found:
    """The search, weighed with as much discrepancy as the best hypothesis leaves.

    It begins with the default. Where even the best hypothesis leaves more than that, base parameters have been bent to
    what is no fault of theirs, so all is fitted once more with the sizes that the best one needs.
    """

    def search(problem: Problem) -> Found:
        one = Search(problem, effects, tell, rivals, base)
        found = one.singles()
        if most_effects > 1:
            found = one.pairs(found)
        for _ in range(2, most_effects):
            found = one.more(found)
        return found

    found = search(problem)
    scores = (score_of(problem, fit) for fit in (found.base, *found.fits.values()))
    size, standstill = min(scores, key=lambda score: score.value).sizes
    if max(size, standstill) <= TOO_SMALL:
        return found
    if standstill > 1.0:  # a fit has bent itself to what is near standstill, and asks for less than there is
        standstill *= STEP
    return search(problem.with_discrepancy((size, standstill)))


@dataclass(frozen=True)
class _Way:
    """To a hypothesis: an effect more beside a leading one. worth: merit of all; gain: what they take off; linearly."""

    worth: float
    gain: float
    leader: Fitted
    promise: Promise


class Search:
    """One campaign's search; `base` keeps the base parameters' knobs, in the order of every fit."""

    def __init__(
        self,
        problem: Problem,
        effects: Iterable[Effect],
        tell: Tell | None = None,
        rivals: Iterable[Effect] = (),
        base: Mapping[str, Value] | None = None,
    ) -> None:
        """rivals: effects that are weighed alone beside the others, so that no pair passes for one of them.

        base: the base parameters' knobs, None for all that have a tolerance.
        """
        self.problem = problem
        self.effects = {each.id: each for each in effects}
        self.rivals = {each.id: each for each in rivals if each.id not in self.effects}
        self.base = dict(base_knobs(problem.machine, problem.runs) if base is None else base)
        self.traces = trace_knobs(problem.machine, problem.runs)
        self.held = [*self.base.values(), *self.traces.values()]
        self.count = sum(len(knob.lowest) for knob in self.held)
        self._tell = tell or (lambda progress: None)
        self.fits: dict[Names, Fitted] = {}
        self.linear: dict[Names, float] = {}
        self.failures: dict[Names, str] = {}
        self.scanned: Sequence[Atom] = ()

    def base_fit(self) -> Fitted:
        """No effect."""
        self._tell(Progress(Stage.SEARCH, Task.BASE))
        return fit_knobs(self.problem, (), self.held, np.zeros(self.count), LAST_ROUND)

    def singles(self) -> Found:
        """The base, and every effect alone."""
        base = self.base_fit()
        within = self._near(base)
        near = replace(within, knobs=base.knobs)  # hypotheses start there, and may go further
        self._tell(Progress(Stage.SEARCH, Task.SIGNATURES))
        signatures = self._signatures([*self.effects.values(), *self.rivals.values()], near)
        self.scanned = signatures
        self._singles(base, near, signatures)
        self._offer_standstill(base)
        return self._found(base, within, signatures)

    def pairs(self, found: Found) -> Found:
        """What `singles` found, and the pairs around the best."""
        near = replace(found.near, knobs=found.base.knobs)
        self._extend(found.base, found.near, 1)
        if any(len(names) == 1 and names[0] in self.effects for names in self.fits):
            self._joint(found.base, near, [atom for atom in found.atoms if atom.effect.id in self.effects])
        self._finish(found.base, [names for names in self.fits if len(names) == 2], PAIR_IN_REACH)
        self._drop(found.base)
        return self._result(found)

    def more(self, found: Found) -> Found:
        """What was found so far, and the leading hypotheses with one more effect each."""
        size = max(len(names) for names in self.fits)
        self._extend(found.base, found.near, size)
        self._finish(found.base, [names for names in self.fits if len(names) == size + 1], PAIR_IN_REACH)
        return self._result(found)

    def _result(self, found: Found) -> Found:
        self._offer_standstill(found.base)
        return self._found(found.base, found.near, found.atoms)

    def _found(self, base: Fitted, near: Fitted, atoms: Sequence[Atom]) -> Found:
        return Found(self.problem, base, near, self.fits, self.linear, atoms, self.failures, frozenset(self.rivals))

    def _near(self, base: Fitted) -> Fitted:
        """The base fit within TOLERANCES: where signatures are taken. One that a large effect has torn far off
        is no place to linearise."""
        if np.all(np.abs(base.z) <= TOLERANCES):
            return base
        # What happens at standstill must not stand in for the gap either.
        far = [TURNED if getattr(k, "logarithmic", False) else TOLERANCES for k in self.held]
        held = [within(k, limit) for k, limit in zip(self.held, far, strict=True)]
        reach = np.repeat(far, [len(k.lowest) for k in self.held])
        z = np.clip(base.z, -reach, reach)
        return fit_knobs(self.problem, (), held, z, LAST_ROUND)

    def _signatures(self, effects: Sequence[Effect], at: Fitted) -> list[Atom]:
        """The signatures of all that can be simulated; what breaks down there is a row in the report.

        Once all shapes have been tried, those that promise most at the point, as they were there, are tried again.
        """
        try:
            found = atoms(self.problem, effects, at.setting, self._likely(effects, at))
        except BREAKDOWNS as error:
            if len(effects) == 1:
                self.failures[(effects[0].id,)] = f"{type(error).__name__}: {error}"
                return []
            found = [atom for each in effects for atom in self._signatures([each], at)]
        broken = {atom.effect.id for atom in found if not np.all(np.isfinite(atom.columns))}
        self.failures |= {(name,): "the simulation breaks down at the values tried first" for name in broken}
        return [atom for atom in found if atom.effect.id not in broken]

    def _likely(self, effects: Sequence[Effect], at: Fitted) -> dict[str, list[Mapping[str, float]]] | None:
        """Effect -> its shapes that promise most at a point, with the signatures that are known. None without any."""
        wanted = {each.id for each in effects}
        gains: dict[str, list[tuple[float, Mapping[str, float]]]] = {}
        projection = Projection.of(self.problem, at) if self.scanned else None
        for atom in self.scanned:
            if projection is not None and atom.effect.id in wanted:
                data, prior, _ = projection.gain(atom)
                gains.setdefault(atom.effect.id, []).append((data + prior, atom.at))
        best = {name: sorted(each, key=lambda q: -q[0])[:SHAPES_AGAIN] for name, each in gains.items()}
        return {name: [at for _, at in each] for name, each in best.items()} or None

    def _singles(self, base: Fitted, near: Fitted, signatures: Sequence[Atom]) -> None:
        promised = self._promised(near, signatures)
        self.linear |= {(name,): each.gain for name, each in promised.items()}
        order = sorted(promised, key=lambda name: -promised[name].merit)
        strained = self._strained(base)
        order = [
            name
            for k, name in enumerate(order)
            if k < ALWAYS or name in strained or (k < REFITTED and promised[name].merit > HOPELESS)
        ]
        for k, name in enumerate(order):
            self._tell(Progress(Stage.SEARCH, Task.SINGLE, k + 1, len(order), (name,)))
            self._try((name,), lambda each=promised[name]: self._fit_with(near, each))  # type: ignore[misc]
        if np.any(near.z != base.z):
            self._from_base(base, order)
            self._with_delay(base)
        self._finish(base, [(name,) for name in order])

    def _strained(self, base: Fitted) -> set[str]:
        """The effects whose trace in every machine has been taken far beyond its tolerance: it may be one of them."""
        return {
            key.partition(".")[0]
            for key, knob in self.traces.items()
            if not getattr(knob, "logarithmic", False)
            and np.any(np.abs(base.z[self._place_of(knob)]) > STRAINED * np.array(knob.prior_std))
        }

    def _place_of(self, wanted: Knob) -> slice:
        """Where a base parameter's or a trace's z stand in every fit."""
        before = [len(knob.lowest) for knob in takewhile(lambda knob: knob is not wanted, self.held)]
        return slice(sum(before), sum(before) + len(wanted.lowest))

    def _from_base(self, base: Fitted, names: Sequence[str]) -> None:
        """From the stretched base too, where that promises more than was found: a fit may be stuck on the way."""
        known = {**self.effects, **self.rivals}
        signatures = self._signatures([known[name] for name in names], base)
        for name, each in self._promised(base, signatures).items():
            fit = self.fits.get((name,))
            if fit is None or base.objective - fit.objective < 0.8 * each.gain:
                self._try((name,), lambda e=each: self._fit_with(base, e))  # type: ignore[misc]

    def _with_delay(self, at: Fitted) -> None:
        """Where a fit has taken the log's timing far beyond its tolerance, a delay in its place: too far for a linear
        promise."""
        late = next((e for e in self.effects.values() for r in self._ranges(e) if r.symbol == self.problem.late), None)
        if late is None or late.id in at.effects or LOG_TIMING not in self.base:
            return
        timing = self.base[LOG_TIMING]
        own = self._place_of(timing)
        taken = float(at.z[own][0])
        if taken <= TOLERANCES:
            return
        more, amount = effect_knobs(late, self._ranges(late), {self.problem.late: taken * timing.scale})
        z = np.concatenate([at.z, amount])
        z[own] = 0.0
        names = (*at.effects, late.id)
        self._try(
            tuple(sorted(names)), lambda: fit_knobs(self.problem, names, [*at.knobs, *more], z, LAST_ROUND, self.count)
        )

    def _ranges(self, effect: Effect) -> tuple[Ranged, ...]:
        return ranges_of(effect, self.problem.machine, self.problem.runs)

    def _finish(self, base: Fitted, tried: Sequence[Names], reach: float = IN_REACH) -> None:
        """Follow to their end the fits that are in reach of the best, or had promised more than it has."""
        done = {names: self.fits[names] for names in tried if names in self.fits}
        best = max((base.objective - fit.objective for fit in done.values()), default=0.0)
        for names, fit in done.items():
            near = base.objective - fit.objective >= reach * best
            if not fit.settled and (near or self.linear.get(names, 0.0) > best):
                self._try(names, lambda f=fit: self._again(f))  # type: ignore[misc]

    def _offer_standstill(self, base: Fitted) -> None:
        """Friction near standstill has more than one local minimum: what the best fit found there, all others in its
        reach try as well, for none may win by luck."""
        if not self.fits:
            return
        donor = min(self.fits.values(), key=lambda fit: fit.objective)
        turns = np.array([getattr(k, "logarithmic", False) for k in self.held for _ in k.lowest], dtype=bool)
        best = base.objective - donor.objective
        for names, fit in list(self.fits.items()):
            apart = np.abs(fit.z[: self.count] - donor.z[: self.count])[turns]
            if base.objective - fit.objective < PAIR_IN_REACH * best or not np.any(apart > STUCK):
                continue
            z = fit.z.copy()
            z[: self.count][turns] = donor.z[: self.count][turns]
            self._try(names, lambda f=fit, z=z: self._again(replace(f, z=z)))  # type: ignore[misc]

    def _again(self, fit: Fitted) -> Fitted:
        return fit_knobs(self.problem, fit.effects, fit.knobs, fit.z, LAST_ROUND, self.count, fit.jacobian)

    def _extend(self, base: Fitted, near: Fitted, size: int) -> None:
        """The leading hypotheses of so many effects, with one more each: those that promise most."""
        known = [names for names in self.fits if len(names) == size and set(names) <= set(self.effects)]
        if not known:
            return
        none = score_of(self.problem, base)
        scores = {names: score_of(self.problem, self.fits[names]) for names in known}
        worth = {names: self._worth(base, self.fits[names], none.value - scores[names].value) for names in known}
        known.sort(key=lambda names: -worth[names])
        leaders = [n for n in known[:LEADERS] if worth[n] > 0.0 and worth[n] >= LEADS * worth[known[0]]]
        ways: dict[Names, list[_Way]] = {}
        leading: set[Names] = set()
        for k, names in enumerate(leaders):
            leader = self.fits[names]
            self._tell(Progress(Stage.SEARCH, Task.PAIRS, k + 1, len(leaders), names))
            again = self._signatures([e for e in self.effects.values() if e.id not in names], leader)
            least = inexact(self.problem, near, leader, scores[names])
            partners = {name: each for name, each in self._promised(leader, again).items() if each.merit > 0.0}
            added = {name: self._worth_beside(leader, each, least) for name, each in partners.items()}
            gained = base.objective - leader.objective
            for rank, name in enumerate(sorted(added, key=lambda name: -added[name])):
                promise = partners[name]
                together: Names = tuple(sorted((*names, name)))
                if rank < PARTNERS:
                    leading.add(together)
                way = _Way(worth[names] + added[name], gained + promise.gain, leader, promise)
                ways.setdefault(together, []).append(way)
        for names in sorted(leading, key=lambda names: -max(way.worth for way in ways[names]))[:EXTENDED_REFITTED]:
            self.linear[names] = max(way.gain for way in ways[names])
            # A promise is linear, and may not be kept: the way from the better hypothesis is tried first.
            for way in sorted(ways[names], key=lambda way: way.leader.objective):
                fit = self.fits.get(names)
                if fit is None or fit.objective > way.leader.objective:
                    self._try(names, lambda w=way: self._fit_with(w.leader, w.promise))  # type: ignore[misc]
        for names in leaders:
            self._with_delay(self.fits[names])

    def _worth(self, base: Fitted, fit: Fitted, gain: float) -> float:
        """A single effect's merit, without what the machine's own discrepancy could be worth. gain: of its score."""
        return beyond_discrepancy(self.problem, base, fit, gain) - cost(self.problem, len(fit.z) - len(base.z))

    def _worth_beside(self, leader: Fitted, promise: Promise, least: float) -> float:
        """What a second effect's promise adds to a leader's merit. least: what the leader's inexact law could be
        worth."""
        taken = promise.atom.columns @ promise.amounts
        z = self._aside(leader, taken, promise.atom)
        left = leader.residual - taken + leader.jacobian @ (z - leader.z)
        data = discounted(self.problem, (promise.atom.effect.id,), promise.data, leader.residual, left)
        paid = promise.gain - promise.merit
        return promise.gain - promise.data + beyond(data, least) - paid

    def _drop(self, base: Fitted) -> None:
        """Each effect of the leading pairs alone, from where the pair left it: a pair is worth what both earn."""
        pairs = sorted((n for n in self.fits if len(n) == 2), key=lambda n: self.fits[n].objective)
        for pair in pairs[:DROPPED]:
            for left in pair:
                self._try((left,), lambda p=pair, n=left: self._without(self.fits[p], n))  # type: ignore[misc]
            self._finish(base, [(left,) for left in pair])

    def _without(self, pair: Fitted, left: str) -> Fitted:
        """The pair's fit with only the effect `left` in it."""
        own = len(self.held)
        mine = [knob for knob in pair.knobs[own:] if left in _effects_of(knob)]
        kept = np.array([True] * self.count + [left in _effects_of(k) for k in pair.knobs[own:] for _ in k.lowest])
        knobs = [*pair.knobs[:own], *mine]
        return fit_knobs(self.problem, (left,), knobs, pair.z[kept], FIRST_ROUND, self.count)

    def _joint(self, base: Fitted, near: Fitted, signatures: Sequence[Atom]) -> None:
        """Pairs of effects of which neither leads alone, where they promise more together than the best alone."""
        alone = (fit.objective for names, fit in self.fits.items() if len(names) == 1 and names[0] in self.effects)
        best = near.objective - min(alone)  # what the best alone takes off, from the same point
        projection = Projection.of(self.problem, near)
        kept: dict[str, list[tuple[float, Atom, Array]]] = {}
        for atom in signatures:
            columns = projection.clean(atom.columns)
            data, prior, _ = linear_gain(columns, projection.residual, columns_signed(atom), projection.priors)
            kept.setdefault(atom.effect.id, []).append((data + prior, atom, columns))
        kept = {name: sorted(each, key=lambda q: -q[0])[:SHAPES_KEPT] for name, each in kept.items()}
        found: list[tuple[float, Names, Atom, Atom, Array]] = []
        for first, second in combinations(sorted(kept), 2):
            if (first, second) in self.fits:
                continue
            options = []
            for _, a, left in kept[first]:
                for _, b, right in kept[second]:
                    signs = [*columns_signed(a), *columns_signed(b)]
                    both = np.hstack([left, right])
                    data, prior, amounts = linear_gain(both, projection.residual, signs, projection.priors)
                    worth = data + prior - cost(self.problem, both.shape[1])
                    options.append((worth, (first, second), a, b, amounts, data + prior))
            worth, names, a, b, amounts, gain = max(options, key=lambda q: q[0])
            self.linear[names] = max(gain, self.linear.get(names, 0.0))
            if gain > best:
                found.append((worth, names, a, b, amounts))
        for _, pair, a, b, amounts in sorted(found, key=lambda q: -q[0])[:PARTNERS]:
            self._try(pair, lambda a=a, b=b, m=amounts: self._fit_both(near, a, b, m))  # type: ignore[misc]

    def _promised(self, at: Fitted, signatures: Sequence[Atom]) -> dict[str, Promise]:
        """Effect -> its best shape, linearly."""
        projection = Projection.of(self.problem, at)
        best: dict[str, Promise] = {}
        for atom in signatures:
            data, prior, amounts = projection.gain(atom)
            size = atom.columns.shape[1] + len(atom.at)
            each = Promise(data + prior, data, data + prior - cost(self.problem, size), atom, amounts)
            if atom.effect.id not in best or each.merit > best[atom.effect.id].merit:
                best[atom.effect.id] = each
        return best

    def _fit_with(self, at: Fitted, promise: Promise) -> Fitted:
        more, start = start_of(self.problem, promise.atom, promise.amounts)
        names = (*at.effects, promise.atom.effect.id)
        beside = self._aside(at, promise.atom.columns @ promise.amounts, promise.atom)
        return self._fit_from(names, [*at.knobs, *more], at.z, beside, start)

    def _fit_both(self, near: Fitted, a: Atom, b: Atom, amounts: Array) -> Fitted:
        split = a.columns.shape[1]
        taken = a.columns @ amounts[:split] + b.columns @ amounts[split:]
        knobs, start = list(near.knobs), list[float]()
        for atom, part in ((a, amounts[:split]), (b, amounts[split:])):
            more, z = start_of(self.problem, atom, part)
            knobs, start = [*knobs, *more], [*start, *z]
        return self._fit_from((a.effect.id, b.effect.id), knobs, near.z, self._aside(near, taken, a, b), start)

    def _fit_from(
        self, names: Names, knobs: Sequence[Knob], at: Array, beside: Array, start: Sequence[float]
    ) -> Fitted:
        """A fit that begins where its own parameters step aside, or as far on the way there as serves: not all of them
        are linear that far."""
        ways = [np.concatenate([at + part * (beside - at), start]) for part in ASIDE]
        white = self.problem.errors.whiten(self.problem.residuals([setting_of(knobs, z) for z in ways]).T)
        std = bounds_of(knobs)[2]
        left = np.sum(white**2, axis=0) + np.array([np.sum((z / std) ** 2) for z in ways])
        z = ways[int(np.argmin(np.where(np.isfinite(left), left, np.inf)))]
        return fit_knobs(self.problem, names, knobs, z, FIRST_ROUND, self.count)

    def _aside(self, at: Fitted, taken: Array, *atoms: Atom) -> Array:
        """Where a fit's own parameters go once effects take so much (samples,) off its residual."""
        delay = self.problem.late in {r.symbol for atom in atoms for r in atom.amounts}
        return stepped_aside(self.problem, at, taken, delay)

    def _try(self, names: Names, fit: Callable[[], Fitted]) -> None:
        """A candidate that breaks down is a row in the report, not the end."""
        try:
            found = fit()
        except BREAKDOWNS as error:
            self.failures[names] = f"{type(error).__name__}: {error}"
            return
        if not np.isfinite(found.objective):
            self.failures[names] = "the simulation breaks down at these values"
        elif names not in self.fits or found.objective < self.fits[names].objective:
            self.fits[names] = found


def _effects_of(knob: Knob) -> set[str]:
    """The effects whose values a knob sets."""
    values = knob.values([0.0] * len(knob.lowest))
    return {symbol.split("__")[0] for symbol in values}
