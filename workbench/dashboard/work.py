"""What the workers of long jobs do: a diagnosis, a comparison of both models, a batch of runs.

Each is called as name(out, tell, **arguments), writes its result into `out` and beside it what the page shows. A view
is a record of words, numbers, tables and figures as one JSON file: the page searches, fits and replays nothing again.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import TypeAdapter, ValidationError
from pydantic_core import from_json

from workbench.core.errors import InputError
from workbench.dashboard.jobs import Teller
from workbench.dashboard.widgets import Number
from workbench.effects import check
from workbench.logs import read_campaign
from workbench.view.page import Section

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

    from workbench.diagnose.diagnose import Diagnosis

VIEW = "view.json"
CSV, REPORT = "index.csv", "report.html"  # of a batch
PARTS = 800  # that a diagnosis is counted in
NEARLY = 0.05  # of the gap: what explains so little less may explain it more plainly
T = TypeVar("T")


@dataclass(frozen=True)
class View:
    """What the page shows of one diagnosis. lead: what the verdict's probability means, what is alike.

    meaning: what each named effect is. numbers: those that decide. sections: the report's, by what they are about.
    plain: the verdict in plain words. place: a drawing of the machine with the gap's place marked, SVG.
    """

    campaign: str
    machine: str
    verdict: str
    sentence: str
    lead: Sequence[str]
    meaning: Sequence[str]
    warnings: Sequence[str]
    numbers: Sequence[Number]
    sections: Mapping[str, Section]
    plain: Sequence[str] = ()
    place: str = ""


def write_view(view: View | Section, path: Path) -> None:
    """As JSON; a figure is plotly's own JSON, which `widgets.chart` draws."""
    path.write_bytes(TypeAdapter(type(view)).dump_json(view, fallback=lambda figure: from_json(figure.to_json())))


def read_view(kind: type[T], path: Path) -> T:
    """InputError for a file that is gone or damaged."""
    try:
        return TypeAdapter(kind).validate_json(path.read_bytes())
    except (OSError, ValidationError) as error:
        raise InputError("this result is damaged; compute it again", file=path) from error


@contextmanager
def _without_folder(folder: str) -> Iterator[None]:
    """An InputError inside comes out without the campaign's folder, which is the server's own."""
    try:
        yield
    except InputError as error:
        file = None if error.file is None else Path(error.file).name
        problem = error.problem.replace(f"{folder}/", "")
        raise InputError(problem, file=file, line=error.line, place=error.place) from error


def diagnosis(
    out: Path, tell: Teller, folder: str, name: str, most_effects: int, candidates: Sequence[str] | None = None
) -> None:
    """Diagnoses the campaign in `folder`, called `name`. InputError for one that cannot be diagnosed."""
    from workbench.diagnose.diagnose import diagnose
    from workbench.diagnose.progress import Progress, Stage
    from workbench.view.diagnosis import progress_words, write_diagnosis

    def said(progress: Progress) -> None:
        tell(progress_words(progress), round(PARTS * progress.share_done), PARTS)

    def written(sentence: str) -> None:  # the last stage, which a diagnosis leaves to whoever writes it down
        tell(sentence, round(PARTS * Progress(Stage.WRITE).share_done), PARTS)

    def diagnosed() -> Diagnosis:
        campaign = replace(read_campaign(folder, confined=True, check_effects=check), name=name)
        return diagnose(campaign, candidates=candidates, most_effects=most_effects, tell=said)

    with _without_folder(folder):
        found = write_diagnosis(diagnosed, out, written)
    write_view(view_of(found), out.parent / VIEW)


def view_of(d: Diagnosis) -> View:
    """The runs are replayed for the figures."""
    from workbench.figures.place import marked_machine
    from workbench.view import diagnosis as words
    from workbench.view.diagnosis import sections_of

    sections = sections_of(d)
    for figure, _ in sections["verdict"].figures:  # for a place of half the page's width
        figure.update_traces(y=[name.replace(" + ", " +<br>") for name in figure.data[0].y]).update_layout(
            title_text="Probability"
        )
    return View(
        d.campaign.name,
        d.campaign.machine.name,
        d.verdict.word,
        d.verdict.sentence,
        [sentence for sentence in (words.probability_sentence(d), words.alike_sentence(d)) if sentence],
        words.effect_sentences(d),
        d.warnings,
        _numbers(d),
        sections | {"answer": replace(sections["answer"], figures=_how_it_shows(d))},
        words.plain_summary(d),
        "" if d.where is None else marked_machine(d.campaign.machine, d.where.subsystem, d.shrink),
    )


def _how_it_shows(d: Diagnosis) -> list[tuple[Figure, str]]:
    """The gap over the one variable that explains it best, for a place of half the page's width."""
    from workbench.view import diagnosis_figures as diagnose_where
    from workbench.view.words import direction_names, words_of

    profiles = [] if d.where is None else [p for p in d.where.profiles if diagnose_where.worth_a_panel(p)]
    if not profiles:
        return []
    most = max(profile.explains for profile in profiles)
    # A mean shows more than a spectrum that explains hardly more.
    best = max(
        (profile for profile in profiles if profile.explains >= most - NEARLY),
        key=lambda profile: (not diagnose_where.is_spectrum(profile), profile.explains),
    )
    machine = d.campaign.machine
    figure = diagnose_where.profiles([best], words_of(machine).unit, direction_names(machine))
    figure.update_traces(showlegend=False, selector={"legendgroup": "share"})
    figure.update_layout(title_text="How the gap shows", margin_t=92).layout.annotations = ()
    explains = round(100.0 * best.explains)
    note = f"{best.label[0].upper()}{best.label[1:]}: explains {explains} % of the gap. Grey: the share of its energy."
    return [(figure, note)]


def _numbers(d: Diagnosis) -> list[Number]:
    from workbench.core.names import powers
    from workbench.view import diagnosis as words
    from workbench.view.words import words_of

    s, w = d.shrink, words_of(d.campaign.machine)
    corrected = d.verdict.word != "no_gap"
    low, high = s.ci95
    band = f"below {s.band_hz:.3g} Hz, on runs that were held out of the fit"
    was = powers(f"; before the correction {s.before:.3g} {s.unit}") if corrected else ""
    numbers = [
        Number(
            f"{w.quantity.capitalize()} residual", s.after, s.unit, s.after - s.before if corrected else None, "lower",
            help=f"rms of measured minus predicted {w.quantity} {band}{was}",
        ),
        Number("Noise floor", s.noise, s.unit, help=f"rms of what a machine without a gap would leave, {band}"),
    ]  # fmt: skip
    if corrected:
        said = f"of the {w.quantity} residual, held out; 95 % interval {low:.3g} to {high:.3g}"
        numbers.append(Number("Shrinks by", s.factor, "×", help=said))
    if s.speed_rmse_percent_after <= words.RUN_AWAY:
        by = s.speed_rmse_percent_after - s.speed_rmse_percent_before
        said = f"rms of the speed replayed open loop, in % of {w.scale}; adds up every bias from the first sample on"
        numbers.append(
            Number("Speed error", s.speed_rmse_percent_after, "%", by if corrected else None, "lower", help=said)
        )
    return numbers


def models(
    out: Path, tell: Teller, folder: str, name: str, runs: Sequence[str], machine: str, source: str = ""
) -> None:
    """Compares both models on the chosen runs of the campaign in `folder`, called `name`.

    machine: the text of a machine.yaml; source: what the page knows the campaign by. InputError for what cannot be
    compared.
    """
    from workbench.machines import load_machine, of_kind, studied
    from workbench.reports.models.report import section_of, write_models
    from workbench.simulate.models import ModelsCompared, compare_models

    given = out.parent / "machine.yaml"
    given.write_text(machine, encoding="utf-8")

    def compared() -> ModelsCompared:
        hoist = studied(load_machine(given, check_effects=check))
        campaign = read_campaign(folder, confined=True, check_effects=check)
        if hoist is None:
            raise InputError(f"is {of_kind(campaign.machine)}; the multi-body machine is a hoist")
        chosen = [run for run in campaign.runs if run.name in runs]
        told = iter(range(len(chosen)))
        return compare_models(
            hoist, chosen, progress=lambda of: tell(f"run {of} on both models", next(told), len(chosen))
        )

    with _without_folder(folder):
        result = write_models(compared, name, out)
    write_view(section_of(result), out.parent / VIEW)


def batch(out: Path, tell: Teller, scenario: str) -> None:
    """Runs the scenario of that file; beside the result its index as CSV and its report come to lie.

    Goes on where an earlier call was stopped. InputError for a scenario that cannot be run.
    """
    from pyarrow.csv import write_csv

    from workbench.study.load import load_study
    from workbench.study.rows import INDEX, read_table
    from workbench.study.store import Progress, place_for, read_finished, run_batch
    from workbench.view.study import write_study_report

    begun = time.monotonic()

    def told(progress: Progress) -> None:
        seconds, made = time.monotonic() - begun, progress.done - progress.kept
        tell("runs", progress.done, progress.runs, progress.failed, made / seconds if seconds > 0.1 else 0.0)

    study = load_study(scenario)
    place = place_for(study, out)
    if not place.finished:
        run_batch(study, place, tell=told)
    failed = read_finished(out).manifest["runs"]["failed"]
    tell("writing the report", 0, 1, failed)
    write_csv(read_table(out / INDEX), out.parent / CSV)
    write_study_report(read_finished(out), out.parent / REPORT)
    tell("runs", len(study.specs), len(study.specs), failed)


def shown(figure: Any) -> Figure:
    """A figure, also one that was read from a view."""
    import plotly.graph_objects as go

    return go.Figure(figure) if isinstance(figure, dict) else figure
