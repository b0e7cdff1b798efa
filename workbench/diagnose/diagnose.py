"""The whole diagnosis: condition of the logs, gap, candidates, verdict, location, shrink, consequences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from workbench.consequences import consequences_of
from workbench.core.errors import InputError, nearest
from workbench.diagnose.candidates import candidates as candidate_rows
from workbench.diagnose.hypotheses.free_parameters import Names, base_parameters
from workbench.diagnose.hypotheses.problem import Problem, rms
from workbench.diagnose.hypotheses.search import SearchResult, searched
from workbench.diagnose.hypotheses.settings import MOST_EFFECTS
from workbench.diagnose.isolation.isolability import isolability
from workbench.diagnose.isolation.next_run import next_run
from workbench.diagnose.location.gap import delivered_of, gap_of
from workbench.diagnose.location.records import Delivered
from workbench.diagnose.location.where import where_of
from workbench.diagnose.machines import corrected_machine, refitted_machine
from workbench.diagnose.progress import Progress, Stage, Tell
from workbench.diagnose.readiness.checks import check_runs
from workbench.diagnose.readiness.condition import condition
from workbench.diagnose.readiness.information import informative_band
from workbench.diagnose.readiness.motion_noise import motion_noise
from workbench.diagnose.records import Diagnosis
from workbench.diagnose.remainder import remainder_of
from workbench.diagnose.shrink import folds_of, shrink_of
from workbench.diagnose.unexplained.unknown import explain, explained_machine
from workbench.diagnose.verdict.answer import Left, Verdict, shared
from workbench.diagnose.verdict.judge import Judged, alike, alternatives, judged_to_help, steps
from workbench.diagnose.words import sentence_of
from workbench.effects import Effect, effects_for
from workbench.logs import Campaign
from workbench.machines import kind_of
from workbench.simulate.replay import replay_runs
from workbench.study.load import Study

BASELINES = ("tolerances", "nominal")


def diagnose(
    campaign: Campaign,
    *,
    baseline: str = "tolerances",
    candidates: Sequence[str] | None = None,
    most_effects: int = MOST_EFFECTS,
    seed: int = 0,
    band_hz: float | None = None,
    quick: bool = False,
    study: bool = True,
    scenario: Study | None = None,
    tell: Tell | None = None,
) -> Diagnosis:
    """The location of the gap between machine and runs, its cause, and its reduction on held-out runs.

    baseline: "tolerances" refits the base parameters with their tolerances as priors, "nominal" keeps them.
    candidates: ids of the effects to weigh, None for the listed ones of the machine's kind. most_effects: largest
    number of effects at once; each further one is searched beside the best hypotheses so far, as long as it is worth
    its parameters. quick: single effects only, and no second search. study:
    whether to compute the changes in the control study. scenario: a user's study, whose moves, limits, payloads and
    controller these are computed with. tell: receives the progress. The same seed gives the same
    answer. InputError if the runs cannot be diagnosed.
    """
    say = tell or (lambda progress: None)
    say(Progress(Stage.READ))
    warnings = check_runs(campaign)
    effects = chosen_effects(campaign, candidates)
    problem = Problem(campaign.machine, campaign.runs, band_hz)
    if band_hz is None and kind_of(campaign.machine).floor == "own":
        band = informative_band(problem.bench, seed)
        if band < problem.band_hz:
            problem = Problem(campaign.machine, campaign.runs, band)
    shaking = motion_noise(problem, seed)
    problem = problem.noisier(shaking)
    state = condition(campaign, problem, rms(shaking))

    others = [effect for effect in effects_for(problem.active.kind).values() if not effect.listed]
    rivals = others if candidates is None else []
    keys = base_parameters(campaign.machine, campaign.runs)
    if baseline == "nominal":
        keys = {key: parameter for key, parameter in keys.items() if parameter.logarithmic}
    elif baseline != "tolerances":
        raise InputError(f"'{baseline}', expected {' or '.join(BASELINES)}", place="baseline")

    search = searched(problem, effects, most_effects, say, rivals, keys, quick)
    problem = search.problem
    say(Progress(Stage.JUDGE))
    judged = judged_to_help(search)
    rows = candidate_rows(search, judged, keys)
    say(Progress(Stage.LOCATE))
    refitted = refitted_machine(problem, keys, search.within_tolerances)
    refitted_replay = replay_runs(refitted, campaign.runs, problem.band_hz)
    gap = gap_of(problem, search, refitted_replay)
    fit = search.fits[judged.names] if judged.names else None
    named = [effect for effect in effects if effect.id in judged.names]
    where = where_of(problem, search.within_tolerances, fit, named, seed) if judged.word != "no_gap" else None
    say(Progress(Stage.SEPARATE))
    apart = isolability(problem, search)
    also = alike(judged, problem.active.kind)
    more = next_run(problem, search, _open(judged, alternatives(judged, problem.active.kind)))
    say(Progress(Stage.SHRINK))
    unknown = explain(problem, search.within_tolerances) if judged.word == "unknown" else None
    if fit is not None:
        corrected = corrected_machine(problem, keys, fit)
    elif unknown is not None:
        corrected = explained_machine(problem, unknown)
    else:
        corrected = refitted
    replayed = refitted_replay if corrected is refitted else replay_runs(corrected, campaign.runs, problem.band_hz)
    delivered = delivered_of(problem.noise, refitted_replay, replayed)
    warnings = (*warnings, *differing(delivered))
    shrink = shrink_of(search, keys, judged.names, folds_of(search, judged.names, unknown), seed, unknown)
    if judged.word == "named" and (also or shrink.ci95[0] <= 1.0):  # the runs leave it open
        judged = replace(judged, ranking=shared(judged.ranking, also))
    say(Progress(Stage.CONSEQUENCES))
    changes, why_not = None, "Not asked for."
    if study and judged.word == "no_gap":
        why_not = "No gap: the study's conclusions stand as they are."
    elif study:
        changes, why_not = consequences_of(
            campaign.machine, corrected, refitted=refitted, runs=campaign.runs, scenario=scenario
        )
    remainder = remainder_of(problem, fit or search.within_tolerances, len(search.base.z), shrink, seed)
    sentence = sentence_of(judged, shrink, remainder, also, corrected.measured_correction is not None)
    verdict = Verdict(
        judged.word,
        judged.names,
        judged.ranking,
        also,
        sentence,
        judged.reasons,
        0.0 if judged.word == "no_gap" else 1.0 - remainder.share,
        Left(remainder.rms, remainder.percent_of_input, remainder.relevant),
        steps(judged, problem.inputs),
        remainder,
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
    )


def differing(delivered: Delivered) -> list[str]:
    """A sentence on a run that is not like the others."""
    total = sum(run.after**2 - run.noise**2 for run in delivered.runs)
    return [
        f"{len(delivered.runs) - 1} runs agree; {run.name} holds "
        f"{100.0 * (run.after**2 - run.noise**2) / total:.0f} % of what stays: "
        "another machine, payload or setting? Look at it, or leave it out."
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


def _open(judged: Judged, also: Sequence[Names]) -> list[Names]:
    """The hypotheses that the campaign does not decide between, the most probable first."""
    first: list[Names] = [judged.names] if judged.names else []
    rest = list(also)
    rest += [row.effects for row in judged.ranking if row.verdict == "named" and row.probability > 0.1]
    return list(dict.fromkeys([*first, *rest]))


__all__ = ["BASELINES", "SearchResult", "chosen_effects", "diagnose"]
