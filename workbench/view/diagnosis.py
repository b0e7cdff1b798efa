"""A diagnosis as people see it: sentences, tables, the sections of its page and of the terminal, its `View`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from workbench.analysis.usual import usual_settings
from workbench.core.errors import InputError
from workbench.core.shown import View
from workbench.core.table import Column, Table, words
from workbench.core.whole_folder import check_free, whole_folder, write_json
from workbench.diagnose.diagnose import Diagnosis
from workbench.diagnose.hypotheses.free_parameters import Estimate
from workbench.diagnose.isolation.planned import Planned
from workbench.diagnose.progress import Progress, Stage, Task
from workbench.diagnose.residual_tests import ALL_RUNS
from workbench.diagnose.saved import FILE, write_diagnosis_file
from workbench.diagnose.unknown import OVER, over_what
from workbench.diagnose.verdict.answer import Candidate, Hypothesis, Reason, ReasonKind, VerdictWord
from workbench.effects import Effect, effects_for
from workbench.machines import kind_of, plant_of, save_machine
from workbench.references import Step
from workbench.study.consequences import consequences_table
from workbench.view import diagnosis_figures as draw
from workbench.view.consequences import before_and_after
from workbench.view.diagnosis_figures import RunSeries
from workbench.view.diagnosis_json import probabilities, to_json
from workbench.view.numbers import NOTHING, figures, with_error
from workbench.view.page import Section, save_page
from workbench.view.words import direction_names, listed, words_of

SHRINKS = 1.02  # factor: less is none
RUN_AWAY = 100.0  # per cent of the speed's scale: a replay in open loop that is further off has left the motion
WORTH_A_BAR = 1e-3  # of probability
MOST_RANKED, MOST_CANDIDATES, MOST_BRIEF, MOST_PROFILES = 8, 24, 5, 9
MOST_WINDOWS = 6  # of a run, that are listed
REGIMES = {
    "speed": "growing with speed",
    "low_speed": "near standstill",
    "acceleration": "with acceleration",
    "load": "with the load",
    "position": "at a position",
    "time": "over time",
    "start": "at each start",
    "periodic": "periodically",
    "event": "at single events",
    "all": "whenever it moves",
}
STAGES = {
    Stage.READ: "reading the logs",
    Stage.SEARCH: "searching the effects",
    Stage.JUDGE: "the verdict",
    Stage.LOCATE: "where the gap lies",
    Stage.SEPARATE: "what these runs can tell apart",
    Stage.SHRINK: "how far the gap shrinks",
    Stage.CONSEQUENCES: "what changes in the control study",
    Stage.WRITE: "writing the report",
}


def progress_words(progress: Progress) -> str:
    """The current step in one short line."""
    names = listed(progress.effects) if progress.effects else ""
    return {
        Task.BASE: "base parameters",
        Task.SIGNATURES: "signatures of all effects",
        Task.SINGLE: f"effect {progress.step} of {progress.steps}: {names}",
        Task.PAIRS: f"pairs with {names}",
    }.get(progress.task, STAGES[progress.stage])


# Sentences.


def hypothesis_name(verdict: VerdictWord, effects: Sequence[str], twins: Sequence[Sequence[str]] = ()) -> str:
    if verdict != "named":
        return {"no_gap": "no gap", "unknown": "unknown cause"}[verdict]
    return " or ".join(" + ".join(names) for names in (effects, *twins))


def probability_sentence(d: Diagnosis) -> str:
    """What the probability in the verdict's sentence means."""
    v = d.verdict
    mine = [row for row in v.ranking if row.verdict == v.word and set(row.effects) == set(v.effects)]
    p = sum(row.probability for row in mine)
    what = {
        "named": "the missing physics would be just this",
        "no_gap": "the machine would lack nothing that these runs can show",
        "unknown": "the cause would be one that the library does not hold",
    }[v.word]
    many = "more than 99" if p > 0.995 else "less than one" if p < 0.005 else f"about {round(100.0 * p)}"
    said = f"That probability means: of a hundred campaigns judged like this one, in {many} {what}."
    named = sum(row.probability for row in v.ranking if row.verdict == "named")
    if v.word == "named" and p < 0.5 and named > p + 0.005:
        return f"{said} In about {100.0 * named:.0f} some effect would be missing, this one or another."
    return said


def alike_sentence(d: Diagnosis) -> str:
    """The effects that these runs cannot tell from the verdict; "" if there are none, or if its sentence names them."""
    if all(name in d.verdict.sentence for name in d.verdict.alike):
        return ""
    return f"These runs cannot tell it from {listed(d.verdict.alike)}: either explains them as well."


def reasons_of(d: Diagnosis) -> list[str]:
    """The reasons for a cause outside the library, as sentences."""
    return [_reason(reason, d.shrink.unit) for reason in d.verdict.reasons]


def _reason(reason: Reason, unit: str) -> str:
    names = listed(reason.effects) if reason.effects else ""
    return {
        ReasonKind.UNLISTED_EXPLAINS_MORE: f"An unlisted effect explains more: {names}. Weigh it among the candidates.",
        ReasonKind.LEAVES_MUCH: f"The best hypothesis leaves {reason.value:.2g} {unit}, {reason.percent:.2g} % of the "
        "input, beyond noise and what a model may miss.",
        ReasonKind.STRETCHES_TOLERANCES: "It needs base parameters further off than their tolerances allow together.",
        ReasonKind.ON_A_BOUND: "It sits on the bound of one of its parameters.",
        ReasonKind.UNDO_EACH_OTHER: f"{names} largely undo each other, as two do that stand in for a third.",
    }[reason.kind]


def effect_sentences(d: Diagnosis) -> list[str]:
    """The declared meaning, equation and signature of each named effect."""
    kind = plant_of(d.campaign.machine).kind
    known = effects_for(kind)
    return [
        f"{name} ({known[name].subsystem(kind).replace('_', ' ')}): {known[name].meaning} {known[name].equation}. "
        f"It shows as {known[name].shows}."
        for name in d.verdict.effects
        if name in known
    ]


def where_sentence(d: Diagnosis) -> str:
    w = d.where
    if w is None:
        return "Where there is no gap, there is no place of it."
    low, high = (round(100.0 * x) for x in w.interval)
    side = {"drive": " It lies on the drive's side of the wire.", "carriage": " It lies on the carriage's side."}
    return (
        f"The gap lies at the {w.subsystem.replace('_', ' ')}, {REGIMES.get(w.regime, w.regime)}: "
        f"{100.0 * w.share:.0f} % of its energy (90 % interval {low} to {high} %) is of this kind and in the "
        f"windows of time that the report marks.{side.get(w.side, '')}"
    )


def shrink_sentence(d: Diagnosis) -> str:
    """The reduction of the gap with its interval, compared with the noise floor."""
    s, w = d.shrink, words_of(d.campaign.machine)
    before, after, noise = (f"{figures(x)} {s.unit}" for x in (s.before, s.after, s.noise))
    if s.before <= 0.0 or d.verdict.word == "no_gap":
        return f"Nothing to shrink: on held-out runs the {w.quantity} residual is {after} rms, the noise {noise}."
    if s.factor < SHRINKS:
        return (
            f"It does not shrink: on held-out runs the {w.quantity} residual is {before} rms before and {after} after; "
            f"the noise floor is {noise}."
        )
    low, high = s.ci95
    run_away = s.speed_rmse_percent_after > RUN_AWAY
    away = "; it has run away, for every bias adds up, and judges neither machine" if run_away else ""
    return (
        f"On runs that were held out of the fit the {w.quantity} residual falls from {figures(s.before)} to {after} "
        f"rms, by a factor of {figures(s.factor)} (95 % interval {figures(low)} to {figures(high)}); the noise floor "
        f"is {noise}. Replayed open loop, the speed's error goes from {figures(s.speed_rmse_percent_before)} to "
        f"{figures(s.speed_rmse_percent_after)} % of {w.scale}{away}."
    )


def next_run_sentence(d: Diagnosis) -> str:
    """The run that would decide between open hypotheses, or that none is open."""
    if d.next_run is not None:
        return d.next_run.why
    return (
        "The verdict needs no further run. Effects that look alike in these runs are listed with their angles: they "
        "stay undecided where a campaign shows one of them in a small amount."
    )


def unknown_sentences(d: Diagnosis) -> list[str]:
    said = [] if d.unknown is None else list(d.unknown.sentences)
    if said and d.corrected.measured_correction is not None:
        over = over_what(d.corrected.measured_correction.over)
        said.append(
            f"machine.yaml holds it, over {over}, as `measured_correction`, which replay and study take into account. "
            "It is a measurement, no explanation."
        )
    return said


def plain_summary(d: Diagnosis) -> list[str]:
    """The verdict for a reader who knows the machine and not this program: what, where, how sure, what it mends."""
    s, kind = d.shrink, plant_of(d.campaign.machine).kind
    known, quantity = effects_for(kind), words_of(d.campaign.machine).quantity
    before, after, noise = (f"{figures(x)} {s.unit}" for x in (s.before, s.after, s.noise))
    if d.verdict.word == "no_gap":
        return [
            f"The model agrees with the machine: predicted and measured {quantity} differ by {after} on average in "
            f"runs that were held out; the sensors alone make {noise}."
        ]
    if d.verdict.word == "unknown" or not all(name in known for name in d.verdict.effects):
        at = f" at the {d.where.subsystem.replace('_', ' ')}" if d.where is not None else ""
        return [
            f"Something{at} is missing in the model, and none of the causes that were weighed explains it. "
            f"Measured and predicted {quantity} differ by {before} on average; the sensors alone make {noise}.",
            "The controller should not be tuned on this model before the cause is found.",
        ]
    causes = [
        f"{_cause(known[name])} (at the {known[name].subsystem(kind).replace('_', ' ')})" for name in d.verdict.effects
    ]
    alike = [_cause(known[name]) for name in d.verdict.alike if name in known]
    or_alike = f", or what looks the same in these runs: {'; '.join(alike)}" if alike else ""
    return [
        f"What the model lacks: {', and '.join(causes)}.",
        f"That made the predicted {quantity} wrong by {before} on average. With it in the model {after} remain; the "
        f"sensors alone make {noise}. In about {100.0 * d.verdict.probability:.0f} of 100 such cases this is the "
        f"cause{or_alike}.",
    ]


def _cause(effect: Effect) -> str:
    """`Friction that grows with the load; on …` as `friction that grows with the load`."""
    first = effect.meaning.partition(";")[0].partition(". ")[0].rstrip(".")
    return first[0].lower() + first[1:]


# Tables.


def unit_of(d: Diagnosis) -> str:
    """The unit of the input for the heads of tables, with non-breaking spaces."""
    return words_of(d.campaign.machine).unit.replace(" ", "\u00a0")


def condition_table(d: Diagnosis) -> Table:
    """The condition of the logs, one row for each run."""
    w = words_of(d.campaign.machine)
    has_payload = kind_of(d.campaign.machine).payload
    columns = [
        words("run"), *([Column("payload", "kg")] if has_payload else []), Column("length", "s"), Column("samples"),
        Column("step", "ms"), Column("noise", unit_of(d)), Column("moving", "%"), Column("clipped", "%"),
        Column("outliers"), Column("delay", "ms"),
    ]  # fmt: skip
    runs = {run.name: run for run in d.campaign.runs}
    rows = [
        [log.name, *([f"{runs[log.name].payload_kg:g}"] if has_payload else []), f"{runs[log.name].duration_s:.1f}",
         str(log.samples), figures(1e3 * log.sample_time_s), figures(log.noise_rms), f"{100.0 * log.moving_share:.0f}",
         figures(100.0 * log.clipped_share, 2), str(log.outliers),
         NOTHING if log.delay_s is None else f"{1e3 * log.delay_s:.0f}"]
        for log in d.condition.runs
    ]  # fmt: skip
    note = (
        f"Noise: rms of the logged {w.quantity} below {d.condition.band_hz:.3g} Hz, where measured and predicted are "
        "compared. Moving: the share of samples that speak of friction and inertia; at rest a machine may hold its "
        "load anywhere within its friction. Delay: logged speed behind its reference."
    )
    return Table(columns, rows, note)


def gap_table(d: Diagnosis) -> Table:
    """The residual of the nominal machine, after the refit within tolerances, and of the delivered machine."""
    g, on_carriage = d.gap, d.gap.force_rms_n is not None
    columns = [
        words("machine"), Column(f"{words_of(d.campaign.machine).quantity}\nresidual", unit_of(d)),
        Column("times\nthe noise"), *([Column("on the\ncarriage", "N")] if on_carriage else []),
        Column("speed error\nopen loop", "%"),
    ]  # fmt: skip
    machines = [
        ("as given", g.nominal_residual_rms, g.nominal_speed_rmse_percent),
        ("refitted within tolerances", g.residual_rms, g.speed_rmse_percent),
        ("delivered", d.delivered.residual_rms, d.delivered.speed_rmse_percent),
    ]
    rows = []
    for name, residual, speed in machines if d.corrected != d.refitted else machines[:2]:
        row = [name, figures(residual), _ratio(residual, g.noise_rms, 2)]
        if g.force_rms_n is not None:  # one lever for all: what a torque is on the carriage
            row.append(_ratio(g.force_rms_n * residual, g.residual_rms))
        rows.append([*row, figures(speed)])
    note = (
        f"Rms while moving, as `replay` prints it in a band of {g.band_hz:.5g} Hz. Open loop: the measured input "
        "drives the model from the first sample on, so every bias adds up; judge by the residual."
    )
    return Table(columns, rows, note)


def _ratio(value: float, noise: float, digits: int = 3) -> str:
    return figures(value / noise, digits) if noise > 0.0 else NOTHING


def runs_table(d: Diagnosis) -> Table:
    """Each run: its share of the gap's energy, its residual before and after, the noise."""
    unit = unit_of(d)
    columns = [words("run"), Column("of the gap's\nenergy", "%"), Column("before", unit), Column("after", unit),
               Column("noise", unit)]  # fmt: skip
    rows = [
        [run.name, f"{100.0 * run.share:.0f}", figures(run.before), figures(run.after), figures(run.noise)]
        for run in d.delivered.runs
    ]
    rows += [
        [f"{run.name}, not in the fit", NOTHING, figures(run.before), figures(run.after), figures(run.noise)]
        for run in d.delivered.validated
    ]
    note = (
        "Before: refitted within tolerances; after: the delivered machine.yaml. Rms while moving, fitted to "
        f"{'the other' if d.delivered.validated else 'all'} runs."
    )
    return Table(columns, rows, note)


def left_table(d: Diagnosis) -> Table:
    """Each run's residual under the delivered machine: whether it is white, and with what it goes together."""
    names = list(dict.fromkeys(name for test in d.residual_tests for name in test.correlations))
    columns = [words("run"), Column("probability\nof white"), Column("lags beyond\nthe 99 % bound"),
               *(Column(f"correlation\nwith {name}") for name in names)]  # fmt: skip
    rows = []
    for test in d.residual_tests:
        beyond = int(np.count_nonzero(np.abs(test.autocorrelation) > test.bound_99))
        found = [test.correlations.get(name) for name in names]
        shown = [NOTHING if c is None else f"{c.value:+.2f}{' *' if abs(c.value) > c.bound_99 else ''}" for c in found]
        rows.append([test.run, draw.percent(test.p_white), f"{beyond} of {len(test.lags_s)}", *shown])
    note = (
        "The residual of the delivered machine while moving, at samples that are independent if it is noise. "
        "Probability: that white noise shows as much autocorrelation (Ljung and Box). *: beyond the 99 % bound."
    )
    return Table(columns, rows, note)


def left_sentence(d: Diagnosis) -> str:
    """Whether anything is left in the residual; "" where no run moves enough to tell."""
    runs = [test for test in d.residual_tests if test.run != ALL_RUNS]
    if not runs:
        return ""
    white = sum(test.white for test in runs)
    related = {name: [t.run for t in runs if name in t.related] for t in runs for name in t.related}
    said = f"Of {len(runs)} run{'s' if len(runs) > 1 else ''} {white} leave{'s' if white == 1 else ''} white noise"
    what = [f"with the {name} in {listed(names)}" for name, names in related.items()]
    return (
        f"{said}; beyond the 99 % bound the residual goes {'; '.join(what)}."
        if what
        else (f"{said}; with speed, position and input no run's residual goes beyond the 99 % bound.")
    )


def where_table(d: Diagnosis) -> Table:
    """Each run's share of the energy of the gap, and the window with most of it; no rows without a gap."""
    columns = [words("run"), Column("of the gap's\nenergy", "%"), Column("windows", "s", "left")]
    rows = []
    windows = d.where.windows if d.where else ()
    for name, share in d.where.energy_by_run.items() if d.where else ():
        mine = [w for w in windows if w.run == name]
        longest = sorted(mine, key=lambda w: w.from_s - w.to_s)[:MOST_WINDOWS]
        spans = [f"{w.from_s:.1f} to {w.to_s:.1f}" for w in mine if w in longest]
        rest = len(mine) - len(spans)
        more = f"; {rest} shorter one{'s' if rest > 1 else ''}" if rest else ""
        rows.append([name, f"{100.0 * share:.0f}", (", ".join(spans) or NOTHING) + more])
    return Table(columns, rows, f"The gap's energy run by run, and the windows that hold most of {_whose(d)}.")


def _whose(d: Diagnosis) -> str:
    return "what the named effect does" if d.verdict.word == "named" else "the gap"


def ranking_table(rows: Sequence[Hypothesis], most: int) -> list[tuple[str, str, float]]:
    """(verdict, name, probability) of the most probable, at least three; the rest in one row without verdict."""
    order = sorted(rows, key=lambda row: -row.probability)
    most = min(most, max(sum(row.probability >= WORTH_A_BAR for row in order), 3))
    shown = [
        (str(row.verdict), hypothesis_name(row.verdict, row.effects, row.twins), row.probability)
        for row in order[:most]
    ]
    if rest := order[most:]:
        name = "1 other" if len(rest) == 1 else f"{len(rest)} others together"
        shown.append(("", name, sum(row.probability for row in rest)))
    return shown


def candidates_table(d: Diagnosis, most: int | None = None, *, brief: bool = False) -> Table:
    """The hypotheses that were fitted and those whose fit failed, in the order of the diagnosis.

    most: largest number of rows. brief: only fitted hypotheses, without parameters and objections.
    """
    unit = unit_of(d)
    columns = [words("hypothesis"), Column("proba-\nbility"), Column("explains", "%"), Column("residual", unit),
               Column("held out", unit), Column("merit")]  # fmt: skip
    if not brief:
        columns += [words("parameters ± standard error"), words("what speaks against it")]
    probability = {
        frozenset(names): row.probability
        for row in d.verdict.ranking
        if row.verdict == "named"
        for names in (row.effects, *row.twins)
    }
    rows = []
    for c in [c for c in d.candidates if c.fitted or (c.failure and not brief)][:most]:
        p = probability.get(frozenset(c.effects))
        no_share = c.explained is None or d.verdict.word == "no_gap"  # of a gap that is none there is no share
        row = [
            hypothesis_name("named", c.effects).replace(" + ", " +\n" if brief else " + "),
            NOTHING if p is None else draw.percent(p),
            NOTHING if no_share else f"{100.0 * (c.explained or 0.0):.0f}",
            *(NOTHING if rms is None else figures(rms) for rms in (c.residual_rms, c.held_out_rms)),
            f"{c.merit:.0f}" if c.fitted and math.isfinite(c.merit) else NOTHING,
        ]
        against = f"its fit broke down: {c.failure}" if c.failure else "; ".join(c.against)
        rows.append(row if brief else [*row, _parameters(c), against])
    left_out = len(d.candidates) - len(rows)
    more = (
        f" {left_out} more hypotheses were weighed, most of them linearly only, for they promised less than these; "
        "diagnosis.json has them all."
        if left_out > 0
        else ""
    )
    note = (
        "Explains: the share of the gap's energy. Held out: residual rms of runs that the fit did not see. Merit: gain "
        "in the penalised likelihood, less what its parameters cost; below 0 it is not worth them. Names end in their "
        f"units.{more}"
    )
    return Table(columns, rows, note)


def _parameters(candidate: Candidate) -> str:
    said = []
    for one in (one for estimates in candidate.parameters.values() for one in estimates):
        # Without an error the value is on a bound, or its effect has vanished.
        pairs = [with_error(*pair) for pair in values_of(one)]
        shown = [f"{value} (not determined)" if std == NOTHING else f"{value} ± {std}" for value, std in pairs]
        said.append(f"{one.name} {'of each run: ' if len(shown) > 1 else ''}{', '.join(shown)}")
    return "; ".join(said)


def values_of(one: Estimate) -> list[tuple[float, float]]:
    """(value, standard error), of each run where it is each run's own."""
    values, errors = ((x if isinstance(x, tuple) else (x,)) for x in (one.value, one.std_error))
    return list(zip(values, errors, strict=True))


def parameters_table(d: Diagnosis, note: str = "") -> Table:
    """The parameters of the named effects, one row for each value; no rows if none is named."""
    columns = [words("effect"), words("parameter"), Column("value"), Column("± std\nerror")]
    rows: list[list[str]] = []
    for effect, estimates in d.chosen.parameters.items() if d.chosen else ():
        for one in estimates:
            own = isinstance(one.value, tuple)
            for run, pair in zip(d.campaign.runs if own else [None], values_of(one), strict=True):
                rows.append([effect, one.name if run is None else f"{one.name}, run {run.name}", *with_error(*pair)])
    return Table(columns, rows, note)


def visible_table(d: Diagnosis) -> Table:
    """The smallest amount of each effect that these runs can show."""
    return Table(
        [words("effect"), words("parameter"), Column("smallest\nvisible")],
        [[name, parameter, figures(size)] for name, (parameter, size) in d.isolability.visible.items()],
        "The smallest amount of each effect that these runs would show. A name's end is its unit.",
    )


def shrink_table(d: Diagnosis) -> Table:
    """The residual of the held-out runs before and after; without a gap only after."""
    s, unit = d.shrink, unit_of(d)
    pairs = dict(s.by_run) if len(s.by_run) < 2 else {**s.by_run, "all runs": (s.before, s.after)}
    note = f"Residual rms below {s.band_hz:.3g} Hz."
    times = Column("after, times\nthe noise")
    if d.verdict.word == "no_gap":
        rows = [[name, figures(after), _ratio(after, s.noise, 2)] for name, (_, after) in pairs.items()]
        return Table([words("held out"), Column("residual", unit), Column("times\nthe noise")], rows, note)
    rows = [
        [name, figures(before), figures(after), _ratio(before, after), _ratio(after, s.noise, 2)]
        for name, (before, after) in pairs.items()
    ]
    return Table(
        [words("held out"), Column("before", unit), Column("after", unit), Column("factor"), times], rows, note
    )


def brief_shrink_table(d: Diagnosis) -> Table:
    """The residual and the replayed speed, before and after."""
    s, w = d.shrink, words_of(d.campaign.machine)
    columns = [words("what"), Column("before"), Column("after"), Column("noise\nfloor"), Column("factor"),
               Column("95 %\ninterval")]  # fmt: skip
    speed = figures(s.speed_rmse_percent_before), figures(s.speed_rmse_percent_after)
    rows = [
        [f"{w.quantity} residual, rms, {w.unit}", figures(s.before), figures(s.after), figures(s.noise),
         figures(s.factor), " to ".join(map(figures, s.ci95))],
        ["speed error, open loop, %", *speed, "", "", ""],
    ]  # fmt: skip
    return Table(columns, rows)


def next_run_table(d: Diagnosis) -> Table:
    """The run that would decide between open hypotheses; no row if none is open."""
    n = d.next_run
    columns = [words("profile"), Column("length", "s"), Column("payload", "kg"), words("signals to log too"),
               Column("apart\nnow"), Column("apart\nwith it"), Column("a plain run\nas long"),
               Column("decides\n20 to 1", "%")]  # fmt: skip
    note = "Apart: how many standard deviations lie between the predictions of the candidates that are still open."
    if n is None:
        return Table(columns, [], note)
    load = f"{n.payload_kg:g}" if kind_of(d.campaign.machine).payload else NOTHING
    length = NOTHING if n.planned is None else figures(n.planned.duration_s)
    row = [n.profile, length, load, ", ".join(n.signals) or NOTHING, figures(n.now, 2), figures(n.separation, 2),
           figures(n.menu, 2), figures(100.0 * n.decides, 2)]  # fmt: skip
    return Table(columns, [row], note)


# Sections: of the page, and of the terminal.


def sections_of(d: Diagnosis) -> dict[str, Section]:
    """The sections of the page by name, in their order. The runs are replayed for the figures."""
    runs = draw.series_of(d)
    v, i = d.verdict, d.isolability
    held = "what is each run's own under `log`" if d.corrected.log.of_runs else "the same values"
    found = parameters_table(
        d, f"Fitted values with one standard error. A name's end is its unit. machine.yaml holds {held}."
    )
    lead = [probability_sentence(d), alike_sentence(d), shrink_sentence(d), *effect_sentences(d)]
    angles = (
        "0°: these runs show one and the same for both effects, so nobody can tell them apart; 90°: unmistakable. "
        "What refitted base parameters could explain is taken out first."
    )
    against = ""
    if v.reasons:
        unknown = v.word == "unknown"
        against = "What speaks for a cause that the library does not hold:" if unknown else "What speaks against it:"
    visible, more = visible_table(d), next_run_table(d)
    ranked = draw.ranking(ranking_table(v.ranking, MOST_RANKED))
    tests = d.residual_tests
    return {
        "answer": Section("", list(filter(None, lead)), d.warnings, [found] if found else []),
        "condition": Section("1. Condition of the logs", (), d.condition.sentences, [condition_table(d)]),
        "gap": Section("2. The gap", (), d.gap.sentences, [gap_table(d), runs_table(d)]),
        "where": _where(d, runs),
        "candidates": Section("4. Candidates", (), (), [candidates_table(d, MOST_CANDIDATES)]),
        "isolability": Section(
            "5. What these runs can tell apart", (), i.sentences, [visible] if visible else [],
            [(draw.isolability(i.names, i.angle, v.effects), angles)] if len(i.names) > 1 else [],
        ),
        "verdict": Section(
            "6. Verdict", list(filter(None, [v.sentence, alike_sentence(d), against])), reasons_of(d), (),
            [(ranked, "")],
        ),
        **({} if d.unknown is None else {"unknown": _unknown(d)}),
        "shrink": _shrink(d, runs),
        **(
            {
                "left": Section(
                    "Is anything left?", [left_sentence(d)], (), [left_table(d)],
                    [(draw.autocorrelations(tests), "Bars beyond the lines are more than chance.")],
                )
            }
            if tests
            else {}
        ),
        "consequences": _consequences(d, "8. What changes in the control study"),
        "next_run": Section("9. The next run", [next_run_sentence(d)], (), [more] if more else []),
    }  # fmt: skip


def _where(d: Diagnosis, runs: tuple[RunSeries, ...]) -> Section:
    unit = words_of(d.campaign.machine).unit
    drawn = draw.inputs(runs, unit)
    fewer = (
        f" Of {len(d.campaign.runs)} runs the {len(runs)} with most of it." if len(d.campaign.runs) > len(runs) else ""
    )
    if d.where is None:
        note = f"No window is marked, for there is no gap.{fewer}"
        return Section("3. Where it lies", [where_sentence(d)], (), (), [(drawn, note)])
    note = f"Per cent: each run's share of the gap. Yellow: the windows that hold most of {_whose(d)}.{fewer}"
    figures = [(drawn, note)]
    shown = sorted(filter(draw.worth_a_panel, d.where.profiles), key=lambda profile: -profile.explains)[:MOST_PROFILES]
    if shown:
        note = (
            "Explains: the share of the gap's energy that a function of this variable and the direction takes away, "
            "with a 90 % interval over runs; the best first. One scale for all means; the share of the energy has its "
            "own in each panel. Over a frequency: the share that one wave in each band takes."
        )
        figures.append((draw.profiles(shown, unit, direction_names(d.campaign.machine)), note))
    return Section("3. Where it lies", [where_sentence(d), *d.where.sentences], (), [where_table(d)], figures)


def _unknown(d: Diagnosis) -> Section:
    drawn = []
    if d.unknown is not None and d.unknown.curves:
        ports = kind_of(d.campaign.machine).ports
        units = [ports[curve.acts_on].unit for curve in d.unknown.curves]  # N at the guide and on a linear axis
        figure = draw.curves(d.unknown.curves, direction_names(d.campaign.machine), OVER, units, d.unknown.law_levels)
        note = "A level for each direction, with a band of two standard errors; positive opposes the motion."
        drawn = [(figure, note)]
    return Section("What is known of the unknown cause", unknown_sentences(d), (), (), drawn)


def _shrink(d: Diagnosis, runs: tuple[RunSeries, ...]) -> Section:
    s, w = d.shrink, words_of(d.campaign.machine)
    left = "Dashed: ± twice the noise. Grey: left out, at an end or at rest, where friction may hold any load."
    driven = f"The measured {w.quantity} drives the machine"
    figures = [draw.residuals(runs, s.unit, d.gap.noise_rms), draw.speeds(runs, w.scale)]
    notes = [left, f"{driven} from the first sample on."]
    if d.verdict.word != "no_gap":
        figures.insert(0, draw.shrink_bars(s.by_run, (s.before, s.after), s.noise, s.unit))
        notes = [
            "Each run predicted by a fit to the others.",
            f"{left} Yellow: the gap's windows. After: the corrected machine, fitted to all runs.",
            f"{driven} before and after its correction, from the first sample on.",
        ]
    drawn = list(zip(figures, notes, strict=True))
    return Section("7. How far it shrinks", [shrink_sentence(d), *s.sentences], (), [shrink_table(d)], drawn)


def _consequences(d: Diagnosis, heading: str) -> Section:
    c = d.consequences
    if c is None:
        return Section(heading, [d.why_no_consequences or "The control study was not asked for."])
    return Section(heading, c.sentences[:1], c.sentences[1:], [consequences_table(c)], [(before_and_after(c), "")])


def brief_sections(d: Diagnosis) -> list[Section]:
    """What the terminal shows: the answer first, then small tables without their notes."""
    v, c = d.verdict, d.consequences
    found = parameters_table(d)
    shrunk = Section("How far it shrinks, on held-out runs", tables=[brief_shrink_table(d)])
    if v.word == "no_gap":
        shrunk = Section("How far it shrinks", [shrink_sentence(d)])
    candidates = candidates_table(d, MOST_BRIEF, brief=True)
    unknown = [*reasons_of(d), *unknown_sentences(d)] if d.unknown is not None else []
    # The first sentence of the consequences says what was run; the report has it.
    changes = [d.why_no_consequences] if c is None else c.sentences[1:]
    sections = [
        Section("", [v.sentence, probability_sentence(d), *filter(None, [alike_sentence(d)])]),
        *([Section("To know first", points=d.warnings)] if d.warnings else []),
        Section("The gap", tables=[gap_table(d)]),
        Section("Each run", tables=[runs_table(d)]),
        *([Section("", [where_sentence(d)])] if d.where is not None else []),
        *([Section("Found", tables=[found])] if found else []),
        Section("Candidates, the best first", tables=[candidates]),
        *([Section("What is known of the unknown cause", points=unknown)] if unknown else []),
        shrunk,
        Section("What changes in the control study", points=changes),
        Section("Is anything left?", list(filter(None, [left_sentence(d)]))),
        Section("The next run", [next_run_sentence(d)]),
    ]
    return [replace(s, tables=[replace(table, note="") for table in s.tables]) for s in sections]


def write_diagnosis(
    run: Callable[[], Diagnosis], folder: Path, say: Callable[[str], None] | None = None, keep: bool = False
) -> Diagnosis:
    """Diagnose, and write diagnosis.json, machine.yaml (corrected) and diagnose.html, or none of them.

    say: called with each step after the diagnosis itself. keep: write diagnosis.pickle too.
    """
    check_free(folder)
    with whole_folder(folder) as hidden:
        diagnosis = run()
        if say is not None:
            say(STAGES[Stage.WRITE])
        write_json(hidden / "diagnosis.json", to_json(diagnosis))
        save_machine(diagnosis.corrected, hidden / "machine.yaml")
        if diagnosis.unknown is not None and diagnosis.unknown.law is not None:
            (hidden / "law.py").write_text(diagnosis.unknown.law.source, encoding="utf-8")
            (hidden / "machine_law.yaml").write_text(diagnosis.unknown.law.machine, encoding="utf-8")
        if diagnosis.next_run is not None and diagnosis.next_run.planned is not None:
            write_next_run(diagnosis, diagnosis.next_run.planned, hidden)
        save_diagnosis_page(diagnosis, hidden / "diagnose.html")
        if keep:
            write_diagnosis_file(diagnosis, hidden / FILE)
    return diagnosis


def write_next_run(d: Diagnosis, planned: Planned, folder: Path) -> None:
    """next_run.csv, the motion as a drive can play it, and next_run.yaml, the same as a scenario of the delivered
    machine."""
    kind, run, limits = kind_of(d.campaign.machine), planned.run, planned.limits
    unit, speed = kind.moved.unit, run[kind.plant.speeds[0]] * kind.transmission_of(d.campaign.machine)
    gone = np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(run.time_s))
    place = planned.start_position + np.concatenate([[0.0], gone])
    table = np.column_stack([run.time_s, place, speed])
    head = f"time_s,position_{unit},speed_{unit}_s"
    np.savetxt(folder / "next_run.csv", table, fmt="%.6g", delimiter=",", header=head, comments="")
    if kind.closed_loop is None:
        return

    def keyed(step: Step) -> dict[str, float]:
        names = {"by_m": f"by_{unit}", "to_m": f"to_{unit}", "speed_m_s": f"speed_{unit}_s"}
        return {names.get(key, key): value for key, value in vars(step).items() if value is not None}

    scenario = {
        "format": 1,
        "name": "next_run",
        "description": "The motion that would decide between the causes that the diagnosis leaves open.",
        "machine": "machine.yaml",
        **({"payloads_kg": [planned.payload_kg]} if kind.payload else {}),
        f"start_position_{unit}": round(planned.start_position, 6),
        "moves": [keyed(step) for step in planned.steps],
        "limits": {
            f"speed_{unit}_s": limits.speed_m_s,
            f"acceleration_{unit}_s2": limits.acceleration_m_s2,
            f"jerk_{unit}_s3": limits.jerk_m_s3,
        },
        "references": ["ruckig"],
        "controller": usual_settings(d.corrected)[0].model_dump(exclude_none=True, exclude_defaults=True),
    }
    text = yaml.safe_dump(scenario, sort_keys=False, allow_unicode=True)
    (folder / "next_run.yaml").write_text(text, encoding="utf-8")


def save_diagnosis_page(d: Diagnosis, path: Path) -> None:
    """Write the page of a diagnosis; it needs no network."""
    title = f"Diagnosis of {d.campaign.machine.name} from campaign {d.campaign.name}"
    save_page(list(sections_of(d).values()), path, title, answer=d.verdict.sentence)


# For notebooks.


def _figure(section: str, number: int = 0) -> Callable[[Diagnosis], Any]:
    def figure(d: Diagnosis) -> Any:
        drawn = sections_of(d).get(section, Section()).figures
        if not drawn:
            raise InputError(f"this diagnosis has nothing to draw there; its verdict is '{d.verdict.word}'")
        return drawn[number][0]

    return figure


def _consequences_table(d: Diagnosis) -> Table:
    if d.consequences is None:
        return Table([words("control study")], [[d.why_no_consequences]])
    return consequences_table(d.consequences)


def _columns(d: Diagnosis) -> Mapping[str, Sequence[Any]]:
    """The ranking: one row a hypothesis, the likeliest first; probabilities sum to 1."""
    rows = sorted(d.verdict.ranking, key=lambda row: -row.probability)
    return {
        "verdict": [row.verdict for row in rows],
        "effects": [" + ".join(row.effects) for row in rows],
        "probability": probabilities([row.probability for row in rows]),
    }


def _shrink_columns(d: Diagnosis) -> Mapping[str, Sequence[Any]]:
    """One row a run, rms of the residual by a fit to the other runs, N m (N)."""
    runs = d.shrink.by_run
    before, after = ([pair[k] for pair in runs.values()] for k in (0, 1))
    return {"run": list(runs), "before": before, "after": after, "noise": [d.shrink.noise] * len(runs)}


def _run_columns(d: Diagnosis) -> Mapping[str, Sequence[Any]]:
    """One row a run under the delivered machine, those kept for the end last."""
    rows = [*d.delivered.runs, *d.delivered.validated]
    names = ("name", "share", "before", "after", "noise", "differs", "p_alike")
    fitted = [True] * len(d.delivered.runs) + [False] * len(d.delivered.validated)
    return {**{name: [getattr(row, name) for row in rows] for name in names}, "in_fit": fitted}


VIEW = View(
    {
        "candidates": lambda d: replace(candidates_table(d, brief=True), note=d.verdict.sentence),
        "parameters": parameters_table,
        "gap": gap_table,
        "runs": runs_table,
        "left": left_table,
        "where": where_table,
        "shrink": shrink_table,
        "condition": condition_table,
        "visible": visible_table,
        "consequences": _consequences_table,
    },
    {
        "ranking": _figure("verdict"),
        "where": _figure("where"),
        "profiles": _figure("where", 1),
        "isolability": _figure("isolability"),
        "shrink": _figure("shrink"),
        "left": _figure("left"),
        "consequences": _figure("consequences"),
    },
    _columns,
    frames={"ranking": _columns, "shrink": _shrink_columns, "runs": _run_columns},
)
