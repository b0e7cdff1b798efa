"""The folder of a diagnosis: JSON, machine, and a page with the answer first and then each step."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from workbench.consequences import consequences_table
from workbench.core.whole_folder import check_free, whole_folder, write_json
from workbench.diagnose.records import Diagnosis
from workbench.diagnose.unexplained.records import Unknown
from workbench.diagnose.unexplained.words import OVER
from workbench.figures import diagnose_time, diagnose_where
from workbench.figures.consequences import before_and_after
from workbench.figures.diagnose_time import RunSeries
from workbench.figures.diagnose_verdict import isolability, ranking, shrink_bars
from workbench.machines import save_machine
from workbench.reports.diagnosis import hypotheses, words
from workbench.reports.diagnosis import tables as report
from workbench.reports.diagnosis.as_json import to_json
from workbench.reports.diagnosis.series import MOST_RUNS, own_values, series_of
from workbench.view.page import Section, save_page
from workbench.view.words import direction_names, words_of

MOST_RANKED, MOST_CANDIDATES, MOST_PROFILES = 8, 24, 9


def sections_of(d: Diagnosis) -> dict[str, Section]:
    """The sections of the page by name, in their order. The runs are replayed for the figures."""
    runs = series_of(d)
    return {
        "answer": _answer(d),
        "condition": _condition(d),
        "gap": _gap(d),
        "where": _where(d, runs),
        "candidates": _candidates(d),
        "isolability": _isolability(d),
        "verdict": _verdict(d),
        **({} if d.unknown is None else {"unknown": _unknown(d, d.unknown)}),
        "shrink": _shrink(d, runs),
        "consequences": _consequences(d),
        "next_run": _next_run(d),
    }


def write_diagnosis(run: Callable[[], Diagnosis], folder: Path, say: Callable[[str], None] | None = None) -> Diagnosis:
    """Diagnose, and write diagnosis.json, machine.yaml (corrected) and diagnose.html, or none of them.

    say: called with each step after the diagnosis itself.
    """
    check_free(folder)
    with whole_folder(folder) as hidden:
        diagnosis = run()
        if say is not None:
            say("writing the report")
        write_json(hidden / "diagnosis.json", to_json(diagnosis))
        save_machine(diagnosis.corrected, hidden / "machine.yaml")
        save_diagnosis_page(diagnosis, hidden / "diagnose.html")
    return diagnosis


def save_diagnosis_page(d: Diagnosis, path: Path) -> None:
    """Write the page of a diagnosis; it needs no network."""
    title = f"Diagnosis of {d.campaign.machine.name} from campaign {d.campaign.name}"
    save_page(list(sections_of(d).values()), path, title, answer=d.verdict.sentence)


def _answer(d: Diagnosis) -> Section:
    """The first section: the answer. The other sections are its evidence."""
    lead = [words.probability_sentence(d), words.alike_sentence(d), words.shrink_sentence(d)]
    lead += words.effect_sentences(d)
    held = "the first run's of what is each run's own" if own_values(d) else "the same values"
    note = f"Fitted values with one standard error. A name's end is its unit. machine.yaml holds {held}."
    table = hypotheses.parameters_table(d, note)
    return Section("", [sentence for sentence in lead if sentence], d.warnings, [table] if table else [])


def _condition(d: Diagnosis) -> Section:
    return Section("1. Condition of the logs", (), d.condition.sentences, [report.condition_table(d)])


def _gap(d: Diagnosis) -> Section:
    return Section("2. The gap", (), d.gap.sentences, [report.gap_table(d), report.runs_table(d)])


def _where(d: Diagnosis, runs: tuple[RunSeries, ...]) -> Section:
    unit = words_of(d.campaign.machine).unit
    fewer = (
        f" Of {len(d.campaign.runs)} runs the {MOST_RUNS} with most of it." if len(d.campaign.runs) > len(runs) else ""
    )
    if d.where is None:
        note = f"No window is marked, for there is no gap.{fewer}"
        return Section(
            "3. Where it lies", [words.where_sentence(d)], (), (), [(diagnose_time.inputs(runs, unit), note)]
        )
    whose = "what the named effect does" if d.verdict.word == "named" else "the gap"
    note = f"Per cent: each run's share of the gap. Yellow: the windows that hold most of {whose}.{fewer}"
    figures = [(diagnose_time.inputs(runs, unit), note)]
    shown = filter(diagnose_where.worth_a_panel, d.where.profiles)
    order = sorted(shown, key=lambda profile: -profile.explains)[:MOST_PROFILES]
    if order:
        note = (
            "Explains: the share of the gap's energy that a function of this variable and the direction takes away, "
            "with a 90 % interval over runs; the best first. One scale for all means; the share of the energy has its "
            "own in each panel. Over a frequency: the share that one wave in each band takes."
        )
        figures.append((diagnose_where.profiles(order, unit, direction_names(d.campaign.machine)), note))
    sentences = [words.where_sentence(d), *d.where.sentences]
    return Section("3. Where it lies", sentences, (), [report.where_table(d)], figures)


def _candidates(d: Diagnosis) -> Section:
    return Section("4. Candidates", (), (), [hypotheses.candidates_table(d, MOST_CANDIDATES)])


def _isolability(d: Diagnosis) -> Section:
    i = d.isolability
    note = (
        "0°: these runs show one and the same for both effects, so nobody can tell them apart; 90°: unmistakable. "
        "What refitted base parameters could explain is taken out first."
    )
    table = report.visible_table(d)
    figure = [(isolability(i.names, i.angle, d.verdict.effects), note)] if len(i.names) > 1 else []
    return Section(
        "5. What these runs can tell apart", (), i.sentences, [table] if table else [], figure,
    )  # fmt: skip


def _verdict(d: Diagnosis) -> Section:
    lead = [d.verdict.sentence, words.alike_sentence(d), words.reasons_lead(d)]
    figure = ranking(hypotheses.ranking_table(d.verdict.ranking, MOST_RANKED))
    return Section("6. Verdict", [s for s in lead if s], words.reasons_of(d), (), [(figure, "")])


def _unknown(d: Diagnosis, unknown: Unknown) -> Section:
    note = "A level for each direction, with a band of two standard errors; positive opposes the motion."
    units = [words.curve_unit(d.campaign.machine, curve.acts_on) for curve in unknown.curves]
    figure = diagnose_where.curves(unknown.curves, direction_names(d.campaign.machine), OVER, units)
    drawn = [(figure, note)] if unknown.curves else []
    return Section("What is known of the unknown cause", words.unknown_sentences(d), (), (), drawn)


def _shrink(d: Diagnosis, runs: tuple[RunSeries, ...]) -> Section:
    s, w = d.shrink, words_of(d.campaign.machine)
    left = "Dashed: ± twice the noise. Grey: left out, at an end or at rest, where friction may hold any load."
    driven = f"The measured {w.quantity} drives the machine"
    figures = [
        (
            diagnose_time.residuals(runs, s.unit, d.gap.noise_rms),
            left
            if d.verdict.word == "no_gap"
            else f"{left} Yellow: the gap's windows. After: the corrected machine, fitted to all runs.",
        ),
        (
            diagnose_time.speeds(runs, w.scale),
            f"{driven} from the first sample on."
            if d.verdict.word == "no_gap"
            else f"{driven} before and after its correction, from the first sample on.",
        ),
    ]
    if d.verdict.word != "no_gap":
        bars = shrink_bars(s.by_run, (s.before, s.after), s.noise, s.unit)
        figures.insert(0, (bars, "Each run predicted by a fit to the others."))
    sentences = [words.shrink_sentence(d), *s.sentences]
    return Section("7. How far it shrinks", sentences, (), [report.shrink_table(d)], figures)


def _consequences(d: Diagnosis) -> Section:
    heading = "8. What changes in the control study"
    c = d.consequences
    if c is None:
        return Section(heading, [d.why_no_consequences or "The control study was not asked for."])
    return Section(heading, c.sentences[:1], c.sentences[1:], [consequences_table(c)], [(before_and_after(c), "")])


def _next_run(d: Diagnosis) -> Section:
    table = report.next_run_table(d)
    return Section("9. The next run", [words.next_run_sentence(d)], (), [table] if table else [])
