"""The whole diagnosis: condition of the logs, gap, candidates, verdict, location, shrink, consequences."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench.core.errors import InputError, nearest
from workbench.core.names import listed
from workbench.core.numbers import figures
from workbench.core.run import Run
from workbench.core.shown import Shown
from workbench.core.verb import attribute
from workbench.diagnose.candidates import candidates as candidate_rows
from workbench.diagnose.gap import (
    Delivered,
    Gap,
    Shrink,
    alike_of,
    delivered_of,
    folds_of,
    gap_of,
    shrink_of,
    stretch_of,
    worst_tolerance,
)
from workbench.diagnose.hypotheses import settings
from workbench.diagnose.hypotheses.evidence import price
from workbench.diagnose.hypotheses.free_parameters import Names, base_parameters
from workbench.diagnose.hypotheses.held_out import play_estimated
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.search import SearchResult, searched
from workbench.diagnose.isolability import Isolability, isolability
from workbench.diagnose.isolation.next_run import APART, LIKELY, NextRun, next_run
from workbench.diagnose.location import places
from workbench.diagnose.location.where import Where, where_of
from workbench.diagnose.machines import corrected_machine, refitted_machine
from workbench.diagnose.progress import Progress, Stage, Tell
from workbench.diagnose.readiness.checks import check_runs, long_enough, variety
from workbench.diagnose.readiness.condition import Condition, condition
from workbench.diagnose.readiness.noise import with_motion_noise
from workbench.diagnose.remainder import remainder_of
from workbench.diagnose.residual_tests import ResidualTest, residual_tests
from workbench.diagnose.verdict.answer import (
    WITHOUT_EFFECTS,
    Candidate,
    Left,
    ReasonKind,
    Remainder,
    Verdict,
    percent_of,
    shared,
)
from workbench.diagnose.verdict.judge import (
    Judged,
    alternatives,
    beside_own_law,
    leaves_off,
    runners_up,
    steps,
    unlisted_likely,
)
from workbench.diagnose.verdict.unknown_cause import beyond_noise
from workbench.effects import Effect, effects_for
from workbench.logs import Campaign
from workbench.machines import Axis, Hoist
from workbench.simulate.motion import own_impacts
from workbench.simulate.noise import usable_band
from workbench.simulate.replay import ReplayResult, replay_runs

if TYPE_CHECKING:
    from workbench.diagnose.unknown import Explained, Unknown
    from workbench.study.consequences import Consequences
    from workbench.study.load import Study

NOISY = 1.5  # times the noise: a residual above it is stated, for the noise does not explain it
STAYS = 0.95  # of the held-out residual: what leaves more of it relieves the tolerances only
MOSTLY = {
    "speed": "with speed",
    "low_speed": "near standstill",
    "acceleration": "with acceleration",
    "load": "with the load",
    "position": "with position",
    "time": "over time",
    "start": "after each start",
    "periodic": "periodically",
}  # regime of a remainder -> how it shows


def either(names: Names, twins: Sequence[Names]) -> str:
    """a; a or b, one cause by two names in these runs; and with what they share: …, and c."""
    if not twins:
        return listed(names)
    others = list(dict.fromkeys(name for twin in twins for name in twin if name not in names))
    shared = [name for name in names if all(name in twin for twin in twins)]
    own = [name for name in names if name not in shared]
    count = {1: "two", 2: "three"}.get(len(others), "several")
    text = f"{' or '.join([*own, *others])}, one cause by {count} names in these runs"
    return f"{text}, and {listed(tuple(shared))}" if shared else text


def sentence_of(
    judged: Judged,
    shrink: Shrink,
    rest: Remainder,
    also: Names,
    tabled: bool = False,
    unlisted: Iterable[str] = (),
    gap: Gap | None = None,
    looked_at: bool = True,
    beside: Names = (),
) -> str:
    """The first sentence of the report: the answer, its probability, and the reduction of the gap.

    tabled: whether the corrected machine contains a measured table of an unknown cause. unlisted: effects of the
    library that the corrected machine contains in its place, and that no answer may name unasked. gap: without a cause,
    and with one that base parameters can stand in for, the one that the refit moves improbably far is stated.
    looked_at: whether the force of an unknown cause was measured at all. beside: unlisted effects, the machine's own.
    """
    unit, before, after = shrink.unit, figures(shrink.before, 2), figures(shrink.after, 2)
    noise = figures(shrink.noise, 2)
    sure = judged.ranking[0].probability
    size = f"{before} {unit} rms on runs held out, noise {noise} {unit}"
    if judged.word == "no_gap":
        if gap is not None and (stretch := stretch_of(gap)):
            return f"No gap stands out ({size}; {chance(sure)}), but these runs put {stretch}: check that value."
        if shrink.after < NOISY * shrink.noise:
            return f"No gap: within its tolerances the model explains these runs ({size}; {chance(sure)})."
        return (
            f"No gap stands out ({chance(sure)}), and no effect of the library is named for what stays: refitted "
            f"within its tolerances the model leaves {after} {unit} rms on runs held out, "
            f"{figures(shrink.after / shrink.noise, 2)} times the noise and {_of_input(rest)}."
        )
    if judged.word == "unknown":
        # Rivals are weighed beside what may be named: one of them may well explain it.
        which = "listed effect" if any(hypothesis.rival for hypothesis in judged.weighed) else "effect of the library"
        head = f"The gap ({size}) has a cause that no {which} explains ({chance(sure)})"
        if sure < 0.5:  # a listed cause is likelier, and the fits do not find it
            head = (
                f"No {which} as it was fitted explains the gap ({size}); {chance(sure)} that its cause is none of them"
            )
        if not looked_at:
            return f"{head}."
        return (
            f"{head}; "
            + (
                f"with {' and '.join(unlisted)}, an effect that is not listed, {after} {unit} are left"
                if unlisted
                else f"with a measured table of it, which is in the corrected machine, {after} {unit} are left"
                if tabled
                else "no table of it keeps what it promises, so the machine holds none"
            )
            + "."
        )
    same = judged.ranking[0].twins
    cause = f"comes from {either(judged.names, same)} ({chance(sure)})"
    by_tolerances = gap is not None and (shrink.after > STAYS * shrink.before or shrink.before <= shrink.noise)
    text = f"beside {listed(beside)}, which is not listed and taken for the machine's own, " if beside else ""
    text += f"{'a small part of the' if leaves_most(rest) and not by_tolerances else 'the'} gap {cause}: "
    text = text[0].upper() + text[1:]
    if gap is not None and by_tolerances:
        text += f"without it these runs put {stretch_of(gap, always=True)}; "
        text += f"the residual on runs held out, {after} {unit}, stays"
    else:
        text += f"on runs held out it shrinks from {before} to {after} {unit}, noise {noise}. "
        text += f"It explains {percent_of(1.0 - rest.share)} of the gap's energy beyond noise"
    if rest.rms > 0.0:
        text += f"; {figures(rest.rms, 2)} {unit} remain, {_of_input(rest)}"
    if others := [name for name in also if not any(name in names for names in same)]:
        it = "it" if len(judged.names) == 1 else "one of them"
        text += f"; these runs cannot tell {it} from {listed(others)}"
    return text + "."


def leaves_most(rest: Remainder) -> bool:
    """Whether an answer explains so little of the gap that it is no more than a part of it."""
    return rest.share > 1.0 - settings.MINOR


def _of_input(rest: Remainder) -> str:
    mostly = f"mostly {MOSTLY[rest.regime]}, " if rest.relevant and rest.regime in MOSTLY else ""
    enough = "enough" if rest.relevant else "too little"
    return f"{figures(rest.percent_of_input, 2)} % of the input, {mostly}{enough} to change a conclusion"


def chance(probability: float) -> str:
    """A probability in words; above 0.99 it is not given exactly."""
    return "probability over 0.99" if probability > 0.99 else f"probability {probability:.2f}"


@dataclass(frozen=True, repr=False)
class Diagnosis(Shown):
    """The results of a diagnosis, in the order of its steps. corrected: the machine for replay and study. quick: only
    names and places were asked for."""

    campaign: Campaign
    seed: int
    condition: Condition
    gap: Gap
    delivered: Delivered
    where: Where | None
    candidates: tuple[Candidate, ...]
    isolability: Isolability
    verdict: Verdict
    next_run: NextRun | None
    shrink: Shrink
    corrected: Hoist | Axis
    refitted: Hoist | Axis
    unknown: Unknown | None
    consequences: Consequences | None
    why_no_consequences: str
    search: SearchResult = field(repr=False, compare=False)
    judged: Judged = field(repr=False, compare=False)
    warnings: tuple[str, ...] = ()
    residual_tests: tuple[ResidualTest, ...] = ()
    quick: bool = False
    replays: tuple[ReplayResult, ReplayResult] | None = field(default=None, repr=False, compare=False)

    def replayed(self) -> tuple[ReplayResult, ReplayResult]:
        """Both machines driven by the logs: refitted within the tolerances, and corrected."""
        if self.replays is not None:
            return self.replays
        runs, band = self.campaign.runs, self.gap.band_hz
        impacts = own_impacts(self.corrected, runs)
        before = replay_runs(self.refitted, runs, band, impacts)
        return before, before if self.corrected == self.refitted else replay_runs(self.corrected, runs, band, impacts)

    @property
    def chosen(self) -> Candidate | None:
        """The candidate that the verdict names."""
        named = self.verdict.word == "named"
        return next((c for c in self.candidates if named and set(c.effects) == set(self.verdict.effects)), None)

    def __getstate__(self) -> dict[str, Any]:
        """Without the search and its replays, which only the process that made them needs."""
        return {**vars(self), "search": None, "judged": None, "replays": None}

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Write what the command writes, and `diagnosis.pickle` for `wb.open_diagnosis`, to a new folder."""
        attribute("workbench.view.diagnosis:write_diagnosis")(lambda: self, Path(folder), keep=True)

    def __repr__(self) -> str:
        """The answer in a few lines; `table()` and `plot()` show the rest."""
        rows = sorted(self.verdict.ranking, key=lambda row: -row.probability)[:3]
        shrink = self.shrink
        before, after, noise = map(figures, (shrink.before, shrink.after, shrink.noise))
        lines = [
            f"Diagnosis of {self.campaign.name}",
            f"  {self.verdict.sentence}",
            *(f"  {row.probability:.2f} {' + '.join(row.effects) or WITHOUT_EFFECTS[row.verdict]}" for row in rows),
            f"  held-out residual: {before} to {after} {shrink.unit}, noise {noise}",
        ]
        if self.where is not None:
            lines.append(f"  where: {self.where.subsystem}, {self.where.regime}")
        lines += [f"  note on the logs: {doubt}" for doubt in self.campaign.doubts]
        return "\n".join(lines)


BASELINES = ("tolerances", "nominal")


def diagnose(
    campaign: Campaign,
    *,
    baseline: str = "tolerances",
    candidates: Sequence[str] | None = None,
    most_effects: int = settings.MOST_EFFECTS,
    seed: int = 0,
    band_hz: float | None = None,
    study: bool = True,
    scenario: Study | None = None,
    quick: bool = False,
    validate: Sequence[str] = (),
    tell: Tell | None = None,
) -> Diagnosis:
    """The location of the gap between machine and runs, its cause, and its reduction on held-out runs.

    baseline: "tolerances" refits the base parameters with their tolerances as priors, "nominal" keeps them.
    candidates: ids of the effects to weigh, None for the listed ones of the machine's kind. most_effects: largest
    number of effects at once; each further one is searched as long as it is worth its parameters. study:
    whether to compute the changes in the control study. scenario: a user's study, whose moves, limits, payloads and
    controller these are computed with. quick: names and places within seconds: single effects, one search; no study,
    no run that would decide, no law of an unknown cause, no other hypothesis on held-out runs.
    validate: names of runs that are kept for the end; no number is fitted to them. tell: receives the progress. The
    same seed gives the same answer. InputError if the runs cannot be diagnosed.
    """
    say = tell or (lambda progress: None)
    say(Progress(Stage.READ))
    campaign, aside = set_aside(campaign, validate)
    most_effects, study = (1, False) if quick else (most_effects, study)
    campaign, short = long_enough(campaign)
    warnings = (*short, *check_runs(campaign))
    effects = chosen_effects(campaign, candidates)
    problem = Problem(campaign.machine, campaign.runs, band_hz)
    if band_hz is None and (band := usable_band(problem.bench, seed)) < problem.band_hz:
        narrow = Problem(campaign.machine, campaign.runs, band)
        problem = narrow if narrow.inputs else problem  # slower than its reversals nothing counts
    problem = with_motion_noise(problem, seed)
    state = condition(campaign, problem, math.sqrt(problem.noise**2 - problem.input_noise**2))

    others = [effect for effect in effects_for(problem.active.kind).values() if not effect.listed]
    rivals = others if candidates is None else []
    keys = base_parameters(campaign.machine, campaign.runs)
    if baseline == "nominal":
        keys = {key: parameter for key, parameter in keys.items() if parameter.logarithmic}
    elif baseline != "tolerances":
        raise InputError(f"'{baseline}', expected {' or '.join(BASELINES)}", place="baseline")

    search = searched(problem, effects, most_effects, say, rivals, keys, quick)
    say(Progress(Stage.JUDGE))
    search, judged = beside_own_law(search, lambda own: searched(problem, effects, 1, say, rivals, keys, quick, own))
    problem = search.problem
    say(Progress(Stage.LOCATE))
    refitted = refitted_machine(problem, keys, search.within_tolerances)
    fit, off = None, False
    if judged.names:
        off = leaves_off(problem, search.fits[judged.names], len(search.base.z))
        fit = play_estimated(problem, search.fits[judged.names], len(search.base.z))
        search = replace(search, fits={**search.fits, judged.names: fit})
        mine = tuple(replace(w, fit=search.fits[w.names]) for w in judged.weighed)
        judged = replace(judged, weighed=mine)
    corrected = refitted if fit is None else corrected_machine(problem, keys, fit)
    impacts = own_impacts(corrected, campaign.runs)  # one choice of samples for all machines
    before, refitted_replay = (
        replay_runs(m, campaign.runs, problem.band_hz, impacts) for m in (campaign.machine, refitted)
    )
    gap = gap_of(problem, search, before, refitted_replay)
    named = [effect for effect in effects if effect.id in judged.names]
    where = where_of(problem, search.within_tolerances, fit, named, seed) if judged.word != "no_gap" else None
    say(Progress(Stage.SEPARATE))
    apart = isolability(problem, search)
    more, as_good = asked_next(search, judged, quick)
    also = tuple(dict.fromkeys(name for names in as_good for name in names if name not in judged.names))
    rows = candidate_rows(search, judged, keys, *([(), int(judged.word == "named")] if quick else [as_good]))
    say(Progress(Stage.SHRINK))
    unlisted = [reason.effects for reason in judged.reasons if reason.kind is ReasonKind.UNLISTED_EXPLAINS_MORE]
    fits = [search.fits[names] for names in unlisted if names in search.fits]
    unknown: Explained | None = None
    if judged.word == "unknown" and not quick:
        from workbench.diagnose.unknown import explain, explained_machine

        unknown = explain(problem, search.within_tolerances, fits, where.subsystem if where else "")
        corrected = explained_machine(problem, unknown)
    replayed = refitted_replay
    if corrected is not refitted:
        replayed = replay_runs(corrected, campaign.runs, problem.band_hz, impacts)
    folds = folds_of(search, judged.names, unknown)
    shrink = shrink_of(search, keys, judged.names, folds, seed, unknown)
    answers = [*([fit] if fit is not None else []), *(w.fit for w in judged.weighed if not quick)]
    alike_runs = alike_of(problem, [*answers, search.within_tolerances])
    # Noise of the machine whose residual stands beside it: one as given, of a late log, had a quarter more in one run.
    noise = with_motion_noise(Problem(corrected, campaign.runs, problem.band_hz), seed).run_noise
    delivered = delivered_of(noise, refitted_replay, replayed, alike_runs)
    if aside:
        struck = own_impacts(corrected, aside)
        first, last = (replay_runs(m, aside, problem.band_hz, struck) for m in (refitted, corrected))
        noise = with_motion_noise(Problem(corrected, aside, problem.band_hz), seed).run_noise
        delivered = replace(delivered, validated=delivered_of(noise, first, last).runs)
    warnings = (*warnings, *differing(delivered))
    held = fit or (unknown.fitted if unknown else search.within_tolerances)
    remainder = remainder_of(problem, held, len(search.base.z), shrink, seed)
    if off and fit is not None:
        key, count, _ = worst_tolerance(keys, fit)
        warnings += (f"with the play {key} stays {abs(count):.1f} tolerances off: another cause may stand beside it",)
    nothing = judged.word == "no_gap" or shrink.before <= shrink.noise  # is there to explain
    explained = 0.0 if nothing else 1.0 - remainder.share
    # That a law is the machine's own is taken, not shown.
    doubted = also or problem.own or explained < settings.MINOR or shrink.ci95[0] <= 1.0 or off
    if judged.word == "named" and doubted:
        judged = replace(judged, ranking=shared(judged.ranking, also))
    say(Progress(Stage.CONSEQUENCES))
    changes, why_not = None, "Not asked for."
    if study and judged.word == "no_gap":
        why_not = "No gap: the study's conclusions stand as they are."
        if remainder.relevant:
            why_not = (
                f"No effect is named that would change them; {figures(remainder.percent_of_input, 2)} % of the input "
                "stay, of which the delivered machine holds nothing, so no study of it does."
            )
    elif study and corrected == refitted:
        why_not = "The delivered machine holds nothing of the cause, so no study of it shows what that changes."
    elif study:
        from workbench.study.consequences import consequences_of

        changes, why_not = consequences_of(
            campaign.machine, corrected, refitted=refitted, runs=campaign.runs, scenario=scenario
        )
    problem.kept.pop(places.KEPT, None)
    tabled, own = corrected.measured_correction is not None, tuple(unknown.effects) if unknown else ()
    without = beyond_noise(problem, shrink.before, shrink.noise)
    reasons = tuple(
        replace(reason, value=without.rms, percent=without.percent_of_input)
        if reason.kind is ReasonKind.LEAVES_MUCH
        else reason
        for reason in judged.reasons
    )
    sentence = sentence_of(judged, shrink, remainder, also, tabled, own, gap, not quick, problem.own)
    verdict = Verdict(
        judged.word,
        judged.names,
        judged.ranking,
        also,
        sentence,
        reasons,
        explained,
        Left(remainder.rms, remainder.percent_of_input, remainder.relevant),
        steps(judged, problem.inputs),
        remainder,
        problem.own,
    )
    return Diagnosis(
        campaign=campaign,
        seed=seed,
        condition=state,
        gap=gap,
        delivered=delivered,
        where=where,
        candidates=rows,
        isolability=apart,
        verdict=verdict,
        next_run=more,
        shrink=shrink,
        corrected=corrected,
        refitted=refitted,
        unknown=unknown,
        consequences=changes,
        why_no_consequences=why_not,
        search=search,
        judged=judged,
        warnings=tuple(warnings),
        residual_tests=residual_tests(replayed),
        quick=quick,
        replays=(refitted_replay, replayed),
    )


def set_aside(campaign: Campaign, names: Sequence[str]) -> tuple[Campaign, tuple[Run, ...]]:
    """The campaign without the named runs, and these. InputError for a name that is none, or where no run is left."""
    known = [run.name for run in campaign.runs]
    for name in names:
        if name not in known:
            raise InputError(f"no run '{name}'; {nearest(name, known)}", place="validate")
    kept = tuple(run for run in campaign.runs if run.name not in names)
    if not kept:
        raise InputError("no run is left to diagnose", place="validate")
    return replace(campaign, runs=kept), tuple(run for run in campaign.runs if run.name in names)


def differing(delivered: Delivered) -> list[str]:
    """A sentence on a run that is not like the others."""
    return [
        f"{len(delivered.runs) - 1} runs agree; {run.name} holds {100.0 * run.stays:.0f} % of what stays (probability "
        f"of as much by chance {'below 0.0001' if run.p_alike < 1e-4 else format(run.p_alike, '.1g')}): another "
        "machine, payload or setting? Look at it, or leave it out."
        for run in delivered.runs
        if run.differs
    ]


def chosen_effects(campaign: Campaign, names: Sequence[str] | None) -> list[Effect]:
    """The effects to weigh. InputError for a name that is none, with the nearest."""
    from workbench.machines import plant_of

    known = effects_for(plant_of(campaign.machine).kind)
    if names is None:
        return [effect for effect in known.values() if effect.listed]
    for name in names:
        if name not in known:
            raise InputError(f"unknown effect '{name}'; {nearest(name, known)}", place="candidates")
    return [known[name] for name in dict.fromkeys(names)]


def asked_next(search: SearchResult, judged: Judged, quick: bool) -> tuple[NextRun | None, tuple[Names, ...]]:
    """The run that would decide what the campaign leaves open, None where nothing is; and what it cannot tell from the
    answer. quick: only that, and no run that it does not take."""
    problem, kind, more = search.problem, search.problem.active.kind, None
    as_good = alternatives(search, judged)
    asked = open_hypotheses(judged, as_good)
    if judged.word != "unknown":  # what would be open where one of these held
        asked = list(dict.fromkeys([*asked, *(one for names in asked for one in alternatives(search, judged, names))]))
    if not quick:
        evidence = {(): price(kind)} | {w.names: w.evidence for w in judged.weighed}
        more = next_run(problem, search, asked, evidence)
        if judged.word == "unknown" and more is None:
            more = next_run(problem, search, unlisted_likely(judged), settled=APART)
    # Where nothing is open, only what the runs do not vary would tell the answer from its runners-up.
    if judged.word == "named" and len(asked) == 1 and variety(problem.bench):
        more = next_run(problem, search, [*asked, *runners_up(judged, kind)], settled=APART)
        as_good = as_good if more is None else more.rivals
    return more, as_good


def open_hypotheses(judged: Judged, also: Sequence[Names]) -> list[Names]:
    """The hypotheses that the campaign does not decide between, the answer first; no gap is that of no effect."""
    first: list[Names] = [judged.names] if judged.word != "unknown" else []
    rest = list(also)
    rest += [row.effects for row in judged.ranking if row.effects and row.probability > LIKELY]
    return list(dict.fromkeys([*first, *rest]))
