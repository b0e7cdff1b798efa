"""The page Validate: a campaign's replay against its measurement, the machine identified from it, both models of it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import streamlit as st

from workbench.core.errors import InputError
from workbench.dashboard import chosen, jobs, session, widgets
from workbench.dashboard.jobs import VIEW, Teller
from workbench.dashboard.widgets import Number, chart, guarded, held, plain, points, problem, table
from workbench.effects import check
from workbench.identify.identify import Identification, identify
from workbench.logs import Campaign, read_campaign
from workbench.machines import kind_of, load_machine, machine_text, of_kind, studied
from workbench.simulate.models import ModelsCompared, check_multibody, compare_models
from workbench.simulate.replay import ReplayResult, replay_runs
from workbench.view import identify as identify_report
from workbench.view import replay as report
from workbench.view.page import Section

OWN = "the campaign's own"
GAP = "The page Gap names what the model lacks."
REPLAYED, FOUND, MODELS = "validate replayed", "validate identified", "models"
MODEL_FILES = (("Report", "models.html", "text/html"), ("models.json", "models.json", "application/json"))


def show() -> None:
    """Draws the page."""
    with st.sidebar, guarded():
        campaign = _chosen(chosen.chosen_campaign("validate campaign"))
    head, button = st.columns([5.0, 1.4], vertical_alignment="center")
    head.markdown(f"#### Campaign {plain(campaign.name)} · {plain(campaign.machine.name)}")
    wanted = button.button("Identify", type="primary", width="stretch", key="validate identify")
    # What decides the numbers: the samples by identity, the machine by value.
    question = (tuple(id(run) for run in campaign.runs), machine_text(campaign.machine))
    with guarded():
        with st.spinner("Replaying the measured input"):
            # The campaign is kept with it, so that no other run can come to have the identity of one of these.
            made = lambda: (replay_runs(campaign.machine, campaign.runs), campaign)  # noqa: E731
            result, _ = session.once(REPLAYED, question, made)
        if wanted:
            with st.spinner("Fitting friction, masses and sensors to the runs"):
                found = identify(campaign, date=datetime.now(UTC).isoformat(timespec="seconds"))
                session.put(FOUND, (question, found))
    last = session.get(FOUND, tuple, ())
    identified: Identification | None = last[1] if last and last[0] == question else None
    machine, now, before, remedy = campaign.machine, result, None, f"Identify fits the values. {GAP}"
    if identified is not None:
        now, before, remedy = identified.after, result, GAP
    _numbers(campaign, now, before)
    st.markdown(plain(" ".join(report.sentences(machine, now, remedy))))
    widgets.notes(campaign.all_notes)
    if identified is not None:
        with guarded():
            _identified(identified)
    st.markdown("##### Replay" if before is None else "##### Replay of the identified machine")
    chart(report.speeds(machine, now), "validate speeds", "Measured and simulated speed of every run")
    chart(report.residuals(machine, now, before), "validate residuals", "Residual of every run over time")
    st.caption(plain(report.said.residuals()))
    chart(report.inputs(machine, now), "validate inputs", "Measured input of every run")
    table(report.table(machine, now))
    if studied(machine) is not None:
        _both_models(campaign)


def _chosen(campaign: Campaign) -> Campaign:
    """The campaign with the runs and the machine that are chosen."""
    names = [run.name for run in campaign.runs]
    picked = st.multiselect("Runs", names, key=held(f"validate runs {campaign.path.name}", names))
    same_kind = {n: m for n, m in chosen.kept_machines().items() if type(m) is type(campaign.machine)}
    machine = st.selectbox("Machine", [OWN, *same_kind], key=held("validate machine", OWN, [OWN, *same_kind]))
    if not picked:
        st.info("Choose at least one run.", icon=":material/info:")
        st.stop()
    runs = tuple(run for run in campaign.runs if run.name in picked)
    return replace(campaign, runs=runs, machine=same_kind.get(machine, campaign.machine))


def _numbers(campaign: Campaign, now: ReplayResult, before: ReplayResult | None) -> None:
    kind = kind_of(campaign.machine)
    w, scale = kind.drive, kind.speed_scale[0]
    residual = f"rms of measured minus predicted {w.quantity}, below {now.band_hz:.3g} Hz, without rests"
    open_loop = f"rms, in % of {scale}; adds up every bias from the first sample on"
    shown = []
    for what, name, unit, tip in (
        ("Speed error, open loop", "speed_rmse_percent", "%", open_loop),
        ("Restarted every 2 s", "speed_rmse_percent_restarted_2s", "%", f"in % of {scale}"),
        (f"{w.quantity.capitalize()} residual, moving", "residual_rms_moving", w.unit, residual),
    ):
        by = None if before is None else getattr(now, name) - getattr(before, name)
        shown.append(Number(what, getattr(now, name), unit, by, "lower", help=tip))
    widgets.numbers([*shown, Number("Sensor noise in this band", now.noise_rms, w.unit)])


def _identified(identified: Identification) -> None:
    """What was found: error bars, the law of friction, the machine to keep or download."""
    head, keep, download = st.columns([3.0, 1.4, 1.4], vertical_alignment="center")
    head.markdown("##### Identified machine")
    with keep:
        name = f"identified from {identified.campaign.name}"
        chosen.keep_button("validate keep", name, lambda: identified.machine)
    with download:
        file = ("machine.yaml", machine_text(identified.machine), "machine.yaml", "application/yaml")
        widgets.downloads("validate download", [file], "stretch")
    left, right = widgets.beside("identified")
    with left:
        fitted = identify_report.estimates(identified.fit)
        chart(fitted, "validate estimates", "Fitted values with error bars and tolerances")
    with right:
        law = identify_report.friction(identified).update_layout(height=470, title_text="")
        chart(law, "validate friction", "Law of friction, nominal and identified, with the log's points")
    points(identify_report.sentences(identified, "the page Gap names what"))
    with st.expander("Values, standard errors, correlations"):
        table(identify_report.table(identified.fit))
        chart(identify_report.correlations(identified), "validate correlation", "Correlations of the fit")


# ---- both models ----------------------------------------------------------------------------------------------------


def work(out: Path, tell: Teller, folder: str, name: str, runs: Sequence[str], machine: str, source: str = "") -> None:
    """In the worker: compares both models on the chosen runs of the campaign in `folder`, called `name`.

    machine: the text of a machine.yaml; source: what the page knows the campaign by. InputError for what cannot be
    compared.
    """
    from workbench.view.models import section_of, write_models

    given = out.parent / "machine.yaml"
    given.write_text(machine, encoding="utf-8")

    def compared() -> ModelsCompared:
        hoist = studied(load_machine(given, check_effects=check))
        campaign = read_campaign(folder, confined=True, check_effects=check)
        if hoist is None:
            raise InputError(f"is {of_kind(campaign.machine)}; the multi-body machine is a hoist")
        picked = [run for run in campaign.runs if run.name in runs]
        told = iter(range(len(picked)))
        said = lambda of: tell(f"run {of} on both models", next(told), len(picked))  # noqa: E731
        return compare_models(hoist, picked, progress=said)

    jobs.write_view(section_of(write_models(compared, name, out)), out.parent / VIEW)


def _both_models(campaign: Campaign) -> None:
    """The lumped and the multi-body machine under the campaign's input: a button, how far it is, or what it found."""
    head, button = st.columns([5.0, 1.4], vertical_alignment="center")
    head.markdown("##### Lumped and multi-body model")
    # What decides the result: the campaign, its chosen runs, the machine.
    asked: dict[str, object] = {
        "name": campaign.name,
        "source": str(campaign.path.resolve()),
        "runs": [run.name for run in campaign.runs],
        "machine": machine_text(campaign.machine),
    }
    own = session.own_jobs(MODELS)
    job = next((job for job in own if asked.items() <= job.arguments.items()), None)
    running = job is not None and not jobs.poll(job).ended
    if button.button("Compare models", width="stretch", key="validate models", disabled=running):
        hoist = studied(campaign.machine)
        assert hoist is not None
        folder, copied = chosen.sent_to_job(campaign)
        try:
            check_multibody(hoist)
            asked |= {"folder": folder}
            job = jobs.start(MODELS, f"{__name__}:work", asked, session.new_work_folder(), campaign.name, copied)
        except InputError as error:
            problem(error)
            return
    if job is None:
        st.caption(
            "Replays the torque of these runs on the multi-body machine too: rigid bodies, joints, rollers and wire. "
            "It takes some seconds a run, in a process of its own."
        )
    elif jobs.poll(job).state == "done":
        with guarded(stop=False):
            section, name = jobs.read_view(Section, job), re.sub(r"[^\w-]", "_", job.title)
            points(section.sentences)
            for shown in section.tables:
                table(shown)
            widgets.figures(section.figures, f"validate models {job.id}")
            with st.container(horizontal=True):
                files = [
                    (words, job.file(f"result/{file}").read_bytes(), f"{name}-{file}", kind)
                    for words, file, kind in MODEL_FILES
                ]
                widgets.downloads("validate models download", files)
    else:
        jobs.cards([job])
