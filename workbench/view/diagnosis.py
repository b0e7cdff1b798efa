"""A diagnosis as people see it: sentences, tables, the sections of its page and of the terminal, its files."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from workbench.core.errors import InputError
from workbench.core.names import listed
from workbench.core.numbers import NOTHING, figures, signed, whole_percent, with_error
from workbench.core.run import integrated
from workbench.core.shown import View
from workbench.core.table import Column, Table, table_of, words
from workbench.core.templates import Sentences
from workbench.core.whole_folder import whole_folder, write_json
from workbench.diagnose.diagnose import NOISY, Diagnosis
from workbench.diagnose.hypotheses.free_parameters import Estimate, Names
from workbench.diagnose.isolation.planned import Planned
from workbench.diagnose.location.where import likely_of
from workbench.diagnose.progress import Progress, Stage, Task
from workbench.diagnose.residual_tests import ALL_RUNS, ResidualTest
from workbench.diagnose.verdict.answer import WITHOUT_EFFECTS, Candidate, Hypothesis, percent_of
from workbench.effects import effects_for
from workbench.machines import kind_of, plant_of, save_machine
from workbench.view import diagnosis_figures as draw
from workbench.view.diagnosis_json import probabilities, to_json
from workbench.view.page import Section, save_page

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
    Stage.SEPARATE: "which effects these runs discriminate",
    Stage.SHRINK: "the residual on held-out runs",
    Stage.CONSEQUENCES: "what changes in the control study",
    Stage.WRITE: "writing the report",
}
Cells = dict[Column, Callable[[Any], str]]


def progress_words(progress: Progress) -> str:
    """The current step in one short line."""
    names = listed(progress.effects or ())
    return {
        Task.BASE: "base parameters",
        Task.SIGNATURES: "signatures of all effects",
        Task.SINGLE: f"effect {progress.step} of {progress.steps}: {names}",
        Task.PAIRS: f"pairs with {names}",
    }.get(progress.task, STAGES[progress.stage])


# Sentences.


def hypothesis_name(verdict: str, effects: Sequence[str], twins: Sequence[Sequence[str]] = ()) -> str:
    if not effects:
        return WITHOUT_EFFECTS[verdict]
    return " or ".join(" + ".join(names) for names in (effects, *twins))


def place_name(subsystem: str) -> str:
    return subsystem.replace("_", " ")


said = Sentences(
    "view/diagnosis_words.j2", figures=figures, listed=listed, place=place_name, percent=whole_percent, REGIMES=REGIMES
)


def probability_sentence(d: Diagnosis) -> str:
    """What the probability in the verdict's sentence means."""
    v = d.verdict
    p = sum(row.probability for row in v.ranking if row.verdict == v.word and set(row.effects) == set(v.effects))
    return said.probability(v, p, sum(row.probability for row in v.ranking if row.effects))


def alike_sentence(d: Diagnosis) -> str:
    """The effects that these runs cannot tell from the verdict; "" if there are none, or if its sentence names them."""
    named = all(name in d.verdict.sentence for name in d.verdict.alike)
    return "" if named else said.alike(d.verdict.alike)


def effect_sentences(d: Diagnosis) -> list[str]:
    """The declared meaning, equation and signature of each named effect."""
    kind = plant_of(d.campaign.machine).kind
    named = [effect for name in d.verdict.effects if (effect := effects_for(kind).get(name)) is not None]
    return [said.effect(effect, place_name(effect.subsystem(kind))) for effect in named]


def where_sentence(d: Diagnosis) -> str:
    likely = likely_of(d.where.places) if d.where else []
    return said.where(d.where, d.verdict.word == "named", len(d.verdict.effects) > 1, d.delivered.runs, likely)


def shrink_sentence(d: Diagnosis) -> str:
    """The reduction of the gap with its interval, compared with the noise floor."""
    s, case, kind = d.shrink, "shrinks", kind_of(d.campaign.machine)
    if s.before <= 0.0 or d.verdict.word == "no_gap":
        case = "none"
    elif s.factor < SHRINKS:
        case = "not"
    elif s.speed_rmse_percent_after > RUN_AWAY:
        case = "run_away"
    return said.shrink(s, kind.drive, case, kind.speed_scale[0])


def next_run_sentence(d: Diagnosis) -> str:
    """The run that would decide between open hypotheses, or that none is open."""
    if d.next_run is not None:
        return d.next_run.why
    if d.quick:
        return "Not asked for."
    first = d.verdict.ranking[0]
    return said.no_next_run(first.verdict, first.probability, d.verdict.left.relevant)


def unknown_sentences(d: Diagnosis) -> list[str]:
    sentences = [] if d.unknown is None else list(d.unknown.sentences)
    if sentences and (correction := d.corrected.measured_correction) is not None:
        from workbench.diagnose.unknown import OVER, over_what, span

        within = span(float(correction.at[0]), float(correction.at[-1]), OVER.get(correction.over, ("", ""))[1])
        sentences.append(said.correction(over_what(correction.over), within.strip()))
    return sentences


def left_sentence(d: Diagnosis) -> str:
    """Whether anything is left in the residual; "" where no run moves enough to tell."""
    runs = [test for test in d.residual_tests if test.run != ALL_RUNS]
    related = {name: [t.run for t in runs if name in t.related] for t in runs for name in t.related}
    times = d.delivered.residual_rms / d.gap.noise_rms
    return said.left(sum(test.white for test in runs), len(runs), related, times * (times > NOISY)) if runs else ""


def plain_summary(d: Diagnosis) -> list[str]:
    """The verdict for a reader who knows the machine and not this program: what, where, how sure, what it mends."""
    v, s, kind, w = d.verdict, d.shrink, plant_of(d.campaign.machine).kind, kind_of(d.campaign.machine).drive
    known = effects_for(kind)
    if v.word == "no_gap":
        return [said.plain_no_gap(s, w)]
    if v.word == "unknown" or not all(name in known for name in v.effects):
        warning = "The controller should not be tuned on this model before the cause is found."
        return [said.plain_unknown(s, w, "" if d.where is None else d.where.subsystem), warning]
    # `Friction that grows with the load; on …` as `friction that grows with the load`.
    meant = {name: re.split(r"; |;|\. ", known[name].meaning)[0].rstrip(".") for name in known}
    cause = {name: text[0].lower() + text[1:] for name, text in meant.items()}
    causes = [f"{cause[name]} (at the {place_name(known[name].subsystem(kind))})" for name in v.effects]
    alike = "; ".join(cause[name] for name in v.alike if name in known)
    return [f"What the model lacks: {', and '.join(causes)}.", said.plain_named(s, w, v.probability, alike)]


# Tables.


def unit_of(d: Diagnosis) -> str:
    """The unit of the input for the heads of tables, with non-breaking spaces."""
    return kind_of(d.campaign.machine).drive.unit.replace(" ", "\u00a0")


def _of(field: str, form: float | str = 1.0, digits: int = 3) -> Callable[[Any], str]:
    """The text of a record's number, times a factor or in a format's form; a dash where it has none."""

    def text(record: Any) -> str:
        value = getattr(record, field)
        if value is None:
            return NOTHING
        return f"{value:{form}}" if isinstance(form, str) else figures(form * value, digits)

    return text


def _percent(field: str) -> Callable[[Any], str]:
    return lambda record: NOTHING if getattr(record, field) is None else f"{100.0 * getattr(record, field):.0f}"


def _ratio(value: float, noise: float, digits: int = 3) -> str:
    return figures(value / noise, digits) if noise > 0.0 else NOTHING


def condition_table(d: Diagnosis) -> Table:
    """The condition of the logs, one row for each run."""
    runs, payload = {run.name: run for run in d.campaign.runs}, Column("payload", "kg")
    cells: Cells = {
        words("run"): _of("name", ""),
        payload: lambda log: f"{runs[log.name].payload_kg:g}",
        Column("length", "s"): lambda log: f"{runs[log.name].duration_s:.1f}",
        Column("samples"): _of("samples", "d"),
        Column("step", "ms"): _of("sample_time_s", 1e3),
        Column("noise", unit_of(d)): _of("noise_rms"),
        Column("moving", "%"): _percent("moving_share"),
        Column("clipped", "%"): _of("clipped_share", 100.0, 2),
        Column("outliers"): _of("outliers", "d"),
        Column("delay", "ms"): lambda log: NOTHING if log.delay_s is None else f"{round(1e3 * log.delay_s)}",
    }
    if not kind_of(d.campaign.machine).payload:
        del cells[payload]
    return table_of(d.condition.runs, cells, said.condition(d, kind_of(d.campaign.machine).drive))


def gap_table(d: Diagnosis) -> Table:
    """The residual of the nominal machine, after the refit within tolerances, and of the delivered machine."""
    g = d.gap
    machines = [
        ("as given", g.nominal_residual_rms, g.nominal_speed_rmse_percent),
        (
            "refitted within tolerances" + "".join(f", with {own}" for own in d.verdict.beside),
            g.residual_rms,
            g.speed_rmse_percent,
        ),
        ("delivered", d.delivered.residual_rms, d.delivered.speed_rmse_percent),
    ]
    cells: Cells = {
        words("machine"): lambda row: row[0],
        Column(f"{kind_of(d.campaign.machine).drive.quantity}\nresidual", unit_of(d)): lambda row: figures(row[1]),
        Column("times\nthe noise"): lambda row: _ratio(row[1], g.noise_rms, 2),
    }
    if (force := g.force_rms_n) is not None:  # one lever for all: what a torque is on the carriage
        cells[Column("on the\ncarriage", "N")] = lambda row: _ratio(force * row[1], g.residual_rms)
    cells[Column("speed error\nopen loop", "%")] = lambda row: figures(row[2])
    return table_of(machines if d.corrected != d.refitted else machines[:2], cells, said.gap(d))


def runs_table(d: Diagnosis) -> Table:
    """Each run: its share of the gap's energy, if there is a gap, its residual before and after, the noise; one that
    rests has none."""
    kept, unit, share = d.delivered.validated, unit_of(d), Column("of the gap's\nenergy", "%")

    def moving(cell: Callable[[Any], str]) -> Callable[[Any], str]:
        return lambda run: cell(run) if run.before > 0.0 else NOTHING

    cells: Cells = {
        words("run"): lambda run: f"{run.name}, not in the fit" if run in kept else run.name,
        share: moving(lambda r: NOTHING if r in kept else f"{100.0 * r.share:.0f}"),
        **{Column(name, unit): moving(_of(name)) for name in ("before", "after", "noise")},
    }
    if d.where is None:
        del cells[share]
    return table_of([*d.delivered.runs, *kept], cells, said.runs(d))


def left_table(d: Diagnosis) -> Table:
    """Each run's residual under the delivered machine: whether it is white, and with what it correlates."""

    def correlation(test: ResidualTest, name: str) -> str:
        found = test.correlations.get(name)
        return f"{signed(found.value, 2)}{' *' if name in test.related else ''}" if found else NOTHING

    names = dict.fromkeys(name for test in d.residual_tests for name in test.correlations)
    heads = ["probability\nof white", "lags beyond\nthe 99 % bound", *(f"correlation\nwith {name}" for name in names)]
    rows = []
    for test in d.residual_tests:
        beyond = f"{np.count_nonzero(np.abs(test.autocorrelation) > test.bound_99)} of {len(test.lags_s)}"
        rows.append([test.run, draw.percent(test.p_white), beyond, *(correlation(test, name) for name in names)])
    return Table([words("run"), *map(Column, heads)], rows, said.left_table())


def where_table(d: Diagnosis) -> Table:
    """Each run's share of the energy of the gap, and the window with most of it; no rows without a gap."""
    rows = []
    for run in d.delivered.runs if d.where else ():
        mine = [w for w in d.where.windows if w.run == run.name] if d.where else []
        longest = sorted(mine, key=lambda w: w.from_s - w.to_s)[:MOST_WINDOWS]
        spans = ", ".join(f"{w.from_s:.1f} to {w.to_s:.1f}" for w in mine if w in longest) or NOTHING
        more = len(mine) - MOST_WINDOWS
        rows.append([run.name, f"{100.0 * run.share:.0f}", f"{spans}; {more} shorter" if more > 0 else spans])
    return Table([words("run"), Column("of the gap's\nenergy", "%"), Column("windows", "s", "left")], rows,
                 said.windows(d))  # fmt: skip


def ranking_table(rows: Sequence[Hypothesis], most: int) -> list[tuple[str, str, float]]:
    """(verdict, name, probability) of the most probable, at least three; the rest in one row without verdict."""
    order = sorted(rows, key=lambda row: -row.probability)
    most = min(most, max(sum(row.probability >= WORTH_A_BAR for row in order), 3))
    names = [(str(row.verdict), hypothesis_name(row.verdict, row.effects, row.twins), row.probability) for row in order]
    others = ("", f"{len(names) - most} more", sum(p for *_, p in names[most:]))
    return [*names[:most], *([others] if names[most:] else [])]


def candidates_table(d: Diagnosis, most: int | None = None, *, brief: bool = False) -> Table:
    """The hypotheses that were fitted and those whose fit failed, in the order of the diagnosis.

    most: largest number of rows. brief: only fitted hypotheses, without parameters and objections.
    """
    shown = [c for c in d.candidates if c.fitted or (c.failure and not brief)][:most]
    rows = {frozenset(names): row for row in d.verdict.ranking if row.effects for names in (row.effects, *row.twins)}
    likely, told = dict[Names, str](), set[Hypothesis]()
    for c in shown:  # names of one hypothesis share its probability, which stands once
        if row := rows.get(frozenset(c.effects)):
            likely[c.effects] = "(same)" if row in told else draw.percent(row.probability)
            told.add(row)
    no_gap = d.verdict.word == "no_gap"  # of a gap that is none there is no share
    cells: Cells = {
        words("hypothesis"): lambda c: (" +\n" if brief else " + ").join(c.effects),
        Column("proba-\nbility"): lambda c: likely.get(c.effects, NOTHING),
        Column("explains"): lambda c: NOTHING if no_gap or c.explained is None else percent_of(c.explained),
        Column("residual", unit_of(d)): _of("residual_rms"),
        Column("held out", unit_of(d)): _of("held_out_rms"),
        Column("merit"): lambda c: f"{c.merit:z.0f}" if c.fitted and math.isfinite(c.merit) else NOTHING,
    }
    if not brief:
        cells[words("parameters ± standard error")] = _parameters
        cells[words("what speaks against it")] = lambda c: (
            f"its fit broke down: {c.failure}" if c.failure else "; ".join(c.against)
        )
    return table_of(shown, cells, said.candidates(len(d.candidates) - len(shown)))


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


def parameters_table(d: Diagnosis) -> Table:
    """The parameters of the named effects, one row for each value; no rows if none is named."""
    rows: list[list[str]] = []
    for effect, estimates in d.chosen.parameters.items() if d.chosen else ():
        for one in estimates:
            runs = [f", run {run.name}" for run in d.campaign.runs] if isinstance(one.value, tuple) else [""]
            for run, pair in zip(runs, values_of(one), strict=True):
                rows.append([effect, one.name + run, *with_error(*pair)])
    heads = [words("effect"), words("parameter"), Column("value"), Column("± std\nerror")]
    return Table(heads, rows, said.parameters(d))


def visible_table(d: Diagnosis) -> Table:
    """The smallest amount of each effect that these runs can show."""
    rows = [[name, parameter, figures(size)] for name, (parameter, size) in d.isolability.visible.items()]
    note = "The smallest amount of each effect that these runs would show. A name's end is its unit."
    return Table([words("effect"), words("parameter"), Column("smallest\nvisible")], rows, note)


def shrink_table(d: Diagnosis) -> Table:
    """The residual of the held-out runs before and after; without a gap only after."""
    s, unit, note = d.shrink, unit_of(d), f"Residual rms below {figures(d.shrink.band_hz)} Hz."
    noise = {run.name: run.noise for run in d.delivered.runs} | {"all runs": s.noise}
    pairs = dict(s.by_run) if len(s.by_run) < 2 else {**s.by_run, "all runs": (s.before, s.after)}
    if d.verdict.word == "no_gap":
        heads = [words("held out"), Column("residual", unit), Column("times\nthe noise")]
        return Table(heads, [[run, figures(b), _ratio(b, noise[run], 2)] for run, (_, b) in pairs.items()], note)
    heads = [words("held out"), Column("before", unit), Column("after", unit), Column("factor"),
             Column("after, times\nthe noise")]  # fmt: skip
    rows = [[run, figures(a), figures(b), _ratio(a, b), _ratio(b, noise[run], 2)] for run, (a, b) in pairs.items()]
    return Table(heads, rows, note)


def brief_shrink_table(d: Diagnosis) -> Table:
    """The residual and the replayed speed, before and after."""
    s, w = d.shrink, kind_of(d.campaign.machine).drive
    heads = ("before", "after", "noise\nfloor", "factor", "95 %\ninterval")
    residual = [*map(figures, (s.before, s.after, s.noise, s.factor)), " to ".join(map(figures, s.ci95))]
    speed = [figures(s.speed_rmse_percent_before), figures(s.speed_rmse_percent_after), "", "", ""]
    whose = " of runs that move" if any(run.before == 0.0 for run in d.delivered.runs) else ""
    rows = [[f"{w.quantity} residual, rms, {w.unit}", *residual], [f"speed error{whose}, open loop, %", *speed]]
    return Table([words("what"), *map(Column, heads)], rows)


def parts_table(d: Diagnosis) -> Table:
    """What the held-out runs' residual consists of; the energies add up."""
    parts = d.shrink.parts
    whole = math.hypot(*parts.values())
    rows = [[name, figures(x), f"{100.0 * (x / whole) ** 2:.2f}"] for name, x in parts.items() if x > 0.0]
    heads = [words("part"), Column("rms", unit_of(d)), Column("of the\nenergy", "%")]
    return Table(heads, [*rows, ["together", figures(whole), "100"]], said.parts(d.shrink))


def next_run_table(d: Diagnosis) -> Table:
    """The run that would decide between open hypotheses; no row if none is open."""
    load = kind_of(d.campaign.machine).payload
    cells: Cells = {
        words("profile"): _of("profile", ""),
        Column("length", "s"): lambda n: NOTHING if n.planned is None else figures(n.planned.duration_s),
        Column("payload", "kg"): lambda n: f"{n.payload_kg:g}" if load else NOTHING,
        words("signals to log too"): lambda n: ", ".join(n.signals) or NOTHING,
        Column("apart\nnow"): _of("now", 1.0, 2),
        Column("apart\nwith it"): _of("separation", 1.0, 2),
        Column("a plain run\nas long"): _of("menu", 1.0, 2),
        Column("decides", "%"): _of("decides", 100.0, 2),
    }
    return table_of([] if d.next_run is None else [d.next_run], cells, said.next_run())


# Sections: of the page, and of the terminal.


def sections_of(d: Diagnosis) -> dict[str, Section]:
    """The sections of the page by name, in their order, numbered. The runs are replayed for the figures."""
    v, i, s, where, unknown = d.verdict, d.isolability, d.shrink, d.where, d.unknown
    kind = kind_of(d.campaign.machine)
    w, ways = kind.drive, kind.directions.names
    runs, gap, corrected = draw.series_of(d), v.word != "no_gap", d.corrected != d.refitted
    profiles = sorted(filter(draw.worth_a_panel, where.profiles if where else ()), key=lambda p: -p.explains)
    against = "What speaks for a cause that the library does not list:" if v.word == "unknown" else (
        "What speaks against it:")  # fmt: skip
    lead = [probability_sentence(d), alike_sentence(d), shrink_sentence(d), *effect_sentences(d)]
    parts = {
        "answer": Section("", lead, d.warnings, [parameters_table(d)]),
        "condition": Section("1. Condition of the logs", (), d.condition.sentences, [condition_table(d)]),
        "gap": Section("2. The gap", (), d.gap.sentences, [gap_table(d), runs_table(d)]),
        "where": Section(
            "3. Where it lies", [where_sentence(d), *(where.sentences if where else ())], (), [where_table(d)],
            [(draw.inputs(runs, w.unit), said.inputs(d, len(runs))),
             (draw.profiles(profiles[:MOST_PROFILES], w.unit, ways) if profiles else None, said.profiles())],
        ),
        "candidates": Section("4. Candidates", (), (), [candidates_table(d, MOST_CANDIDATES)]),
        "isolability": Section(
            "5. Isolability of the effects", (), i.sentences, [visible_table(d)],
            [(draw.isolability(i.names, i.angle, v.effects) if len(i.names) > 1 else None, said.angles())],
        ),
        "verdict": Section(
            "6. Verdict", [v.sentence, alike_sentence(d), against if v.reasons else ""],
            [said.reason(reason, s.unit) for reason in v.reasons], (),
            [(draw.ranking(ranking_table(v.ranking, MOST_RANKED)), "")],
        ),
    }  # fmt: skip
    if unknown is not None:
        from workbench.diagnose.unknown import OVER

        units = [kind_of(d.campaign.machine).ports[curve.acts_on].unit for curve in unknown.curves]
        curves = draw.curves(unknown.curves, ways, OVER, units, unknown.law_levels) if units else None
        drawn = [(curves, said.curves(unknown.law is not None))]
        parts["unknown"] = Section("What is known of the unknown cause", unknown_sentences(d), (), (), drawn)
    bars = draw.shrink_bars(s.by_run, (s.before, s.after), s.noise, s.unit) if gap else None
    parts["shrink"] = Section(
        "7. Residual on held-out runs", [shrink_sentence(d), *s.sentences], (), [shrink_table(d), parts_table(d)],
        [(bars, "Each run predicted by a fit to the others."),
         (draw.residuals(runs, s.unit, d.gap.noise_rms), said.residuals(gap, corrected)),
         (draw.speeds(runs, kind.speed_scale[0]), said.speeds(corrected, w))],
    )  # fmt: skip
    if d.residual_tests:
        drawn = [(draw.autocorrelations(d.residual_tests), said.autocorrelation())]
        parts["left"] = Section("8. Is anything left?", [left_sentence(d)], (), [left_table(d)], drawn)
    changes = Section("9. What changes in the control study", [d.why_no_consequences or "It was not asked for."])
    if (c := d.consequences) is not None:
        drawn = [(draw.consequences(c), "")]
        changes = Section(changes.heading, c.sentences[:1], c.sentences[1:], [_consequences_table(d)], drawn)
    parts["consequences"] = changes
    parts["next_run"] = Section("10. The next run", [next_run_sentence(d)], (), [next_run_table(d)])
    return parts


def brief_sections(d: Diagnosis) -> list[Section]:
    """What the terminal shows: the answer first, then small tables."""
    v, c = d.verdict, d.consequences
    left = Section("Residual on held-out runs", tables=[brief_shrink_table(d)])
    if v.word == "no_gap":
        left = Section(left.heading, [shrink_sentence(d)])
    why = [said.reason(reason, d.shrink.unit) for reason in v.reasons]
    sections = [
        Section("", [v.sentence, probability_sentence(d), alike_sentence(d)]),
        Section("To know first", points=d.warnings),
        Section("The gap", tables=[gap_table(d)]),
        Section("Each run", tables=[runs_table(d)]),
        Section("", [where_sentence(d)] if d.where is not None else []),
        Section("Found", tables=[parameters_table(d)]),
        Section("Candidates, the best first", tables=[candidates_table(d, MOST_BRIEF, brief=True)]),
        Section("What speaks against it", points=why if v.word == "no_gap" else ()),
        Section("What is known of the unknown cause", points=[*why, *unknown_sentences(d)] if d.unknown else ()),
        left,
        # The first sentence of the consequences says what was run; the report has it.
        Section("What changes in the control study", points=[d.why_no_consequences] if c is None else c.sentences[1:]),
        Section("Is anything left?", [left_sentence(d)]),
        Section("The next run", [next_run_sentence(d)]),
    ]
    return list(filter(None, sections))


def write_diagnosis(
    run: Callable[[], Diagnosis], folder: Path, say: Callable[[str], None] | None = None, keep: bool = False
) -> Diagnosis:
    """Diagnose, and write diagnosis.json, machine.yaml (corrected) and diagnose.html, or none of them.

    say: called with each step after the diagnosis itself. keep: write diagnosis.pickle too.
    """
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
            from workbench.diagnose.saved import FILE, write_diagnosis_file

            write_diagnosis_file(diagnosis, hidden / FILE)
    return diagnosis


def write_next_run(d: Diagnosis, planned: Planned, folder: Path) -> None:
    """next_run.csv, the motion as a drive can play it, and next_run.yaml, the same as a scenario of the delivered
    machine."""
    from workbench.analysis.usual import usual_settings
    from workbench.study.scenario import key_in

    kind, run = kind_of(d.campaign.machine), planned.run
    unit, speed = kind.moved.unit, run[kind.plant.speeds[0]] * kind.transmission_of(d.campaign.machine)
    position = planned.start_position + integrated(speed, run.time_s)
    table = np.column_stack([run.time_s, position, speed])
    head = f"time_s,position_{unit},speed_{unit}_s"
    np.savetxt(folder / "next_run.csv", table, fmt="%.6g", delimiter=",", header=head, comments="")
    if kind.closed_loop is None:
        return
    scenario = {
        "format": 1,
        "name": "next_run",
        "description": "The motion that would decide between the causes that the diagnosis leaves open.",
        "machine": "machine.yaml",
        **({"payloads_kg": [planned.payload_kg]} if kind.payload else {}),
        f"start_position_{unit}": round(planned.start_position, 6),
        "moves": [{key_in(unit, k): v for k, v in vars(step).items() if v is not None} for step in planned.steps],
        "limits": {key_in(unit, name): round(value, 6) for name, value in vars(planned.limits).items()},
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
        if len(drawn) <= number:
            raise InputError(f"this diagnosis has nothing to draw there; its verdict is '{d.verdict.word}'")
        return drawn[number][0]

    return figure


def _consequences_table(d: Diagnosis) -> Table:
    if d.consequences is None:
        return Table([words("control study")], [[d.why_no_consequences]])
    from workbench.study.consequences import consequences_table

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
    return {"run": list(runs), "before": before, "after": after, "noise": [run.noise for run in d.delivered.runs]}


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
        "parts": parts_table,
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
