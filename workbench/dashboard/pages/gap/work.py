"""What a diagnosis' worker does: diagnose, write what is downloaded, and what the page shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from workbench.dashboard.jobs.progress import Teller
from workbench.dashboard.pages.gap.view import VIEW, View, write_view
from workbench.dashboard.widgets import Number
from workbench.diagnose.diagnose import diagnose
from workbench.diagnose.progress import Progress, Stage
from workbench.diagnose.records import Diagnosis
from workbench.effects import check
from workbench.errors import InputError
from workbench.figures import diagnose_where
from workbench.figures.place import marked_machine
from workbench.logs import read_campaign
from workbench.names import powers
from workbench.reports.diagnosis import words
from workbench.reports.diagnosis.page import sections_of, write_diagnosis
from workbench.reports.diagnosis.progress import progress_words, share_done
from workbench.reports.words import direction_names, words_of

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

PARTS = 800  # that a diagnosis is counted in
NEARLY = 0.05  # of the gap: what explains so little less may explain it more plainly


def run(
    out: Path, tell: Teller, folder: str, name: str, most_effects: int, candidates: Sequence[str] | None = None
) -> None:
    """Diagnose the campaign in `folder`, called `name`, into `out`; beside it comes to lie what the page shows.

    InputError for a campaign that cannot be diagnosed, without the folder's path, which is the server's own.
    """
    said = _Progress(tell)

    def diagnosed() -> Diagnosis:
        campaign = read_campaign(folder, confined=True, check_effects=check)
        return diagnose(
            replace(campaign, name=name), candidates=candidates, most_effects=most_effects, tell=said.stage
        )  # fmt: skip

    try:
        written = write_diagnosis(diagnosed, out, said.report)
    except InputError as error:
        file = None if error.file is None else Path(error.file).name
        problem = error.problem.replace(f"{folder}/", "")
        raise InputError(problem, file=file, line=error.line, place=error.place) from error
    write_view(view_of(written), out.parent / VIEW)


class _Progress:
    """Hands the diagnosis' progress to the job, stage by stage and step by step."""

    def __init__(self, tell: Teller) -> None:
        self.tell = tell

    def stage(self, progress: Progress) -> None:
        self.tell(progress_words(progress), round(PARTS * share_done(progress)), PARTS)

    def report(self, sentence: str) -> None:
        """The last stage, which a diagnosis leaves to whoever writes it down."""
        self.tell(sentence, round(PARTS * share_done(Progress(Stage.WRITE))), PARTS)


def view_of(d: Diagnosis) -> View:
    """The runs are replayed for the figures."""
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
    profiles = (
        [] if d.where is None else [profile for profile in d.where.profiles if diagnose_where.worth_a_panel(profile)]
    )
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
    if s.speed_rmse_percent_after > words.RUN_AWAY:
        return numbers
    by = s.speed_rmse_percent_after - s.speed_rmse_percent_before
    said = f"rms of the speed replayed open loop, in per cent of {w.scale}; adds up every bias from the first sample on"
    numbers.append(
        Number("Speed error", s.speed_rmse_percent_after, "%", by if corrected else None, "lower", help=said)
    )
    return numbers
