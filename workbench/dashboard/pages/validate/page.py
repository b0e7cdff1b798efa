"""The page Validate: a campaign's replay against its measurement, the machine identified from it, both models of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import streamlit as st

from workbench.dashboard.campaigns import chosen_campaign
from workbench.dashboard.machines import kept_machines
from workbench.dashboard.pages.validate.identification import found_for, identification, offer
from workbench.dashboard.pages.validate.models import both_models
from workbench.dashboard.pages.validate.replay import replayed
from workbench.dashboard.widgets import Number, chart, guarded, numbers, plain, table
from workbench.logs import Campaign
from workbench.reports.replay import report
from workbench.reports.replay.page import RESIDUAL_NOTE, inputs, residuals, speeds
from workbench.reports.words import words_of
from workbench.simulate.replay import ReplayResult

OWN = "the campaign's own"
GAP = "The page Gap names what the model lacks."


def show() -> None:
    """Draws the page."""
    with st.sidebar, guarded():
        whole = chosen_campaign("validate campaign")
        campaign = _chosen(whole)
    head, button = st.columns([5.0, 1.4], vertical_alignment="center")
    head.markdown(f"#### Campaign {plain(campaign.name)} · {plain(campaign.machine.name)}")
    wanted = button.button("Identify", type="primary", width="stretch", key="validate identify")
    with guarded():
        with st.spinner("Replaying the measured input"):
            result = replayed(campaign)
        if wanted:
            with st.spinner("Fitting friction, masses and sensors to the runs"):
                identification(campaign)
    identified = found_for(campaign)
    after = None if identified is None else identified.after
    _numbers(campaign, result, after)
    remedy = GAP if identified is not None else f"Identify fits the values. {GAP}"
    st.markdown(plain(" ".join(report.sentences(campaign.machine, after or result, remedy))))
    _notes(campaign)
    if identified is not None:
        with guarded():
            offer(identified)
    st.markdown("##### Replay" if after is None else "##### Replay of the identified machine")
    _figures(campaign, after or result, None if after is None else result)
    both_models(campaign)


def _chosen(campaign: Campaign) -> Campaign:
    """The campaign with the runs and the machine that are chosen."""
    names = [run.name for run in campaign.runs]
    chosen = st.multiselect("Runs", names, names, key=f"validate runs {campaign.path.name}")
    same_kind = {n: m for n, m in kept_machines().items() if type(m) is type(campaign.machine)}
    machine = st.selectbox("Machine", [OWN, *same_kind], key="validate machine")
    if not chosen:
        st.info("Choose at least one run.", icon=":material/info:")
        st.stop()
    runs = tuple(run for run in campaign.runs if run.name in chosen)
    return replace(campaign, runs=runs, machine=same_kind.get(machine, campaign.machine))


def _numbers(campaign: Campaign, result: ReplayResult, after: ReplayResult | None) -> None:
    w, now = words_of(campaign.machine), after or result

    def delta(new: float, old: float) -> float | None:
        return None if after is None else new - old

    numbers(
        [
            Number("Speed error, open loop", now.speed_rmse_percent, "%",
                   delta(now.speed_rmse_percent, result.speed_rmse_percent), "lower",
                   help=f"rms, in per cent of {w.scale}; adds up every bias from the first sample on"),
            Number("The same, restarted every 2 s", now.speed_rmse_percent_restarted_2s, "%",
                   delta(now.speed_rmse_percent_restarted_2s, result.speed_rmse_percent_restarted_2s), "lower"),
            Number(f"{w.quantity.capitalize()} residual, moving", now.residual_rms_moving, w.unit,
                   delta(now.residual_rms_moving, result.residual_rms_moving), "lower",
                   help=f"rms of measured minus predicted {w.quantity}, below {now.band_hz:.3g} Hz, without rests"),
            Number("Sensor noise in this band", now.noise_rms, w.unit),
        ]
    )  # fmt: skip


def _notes(campaign: Campaign) -> None:
    notes: Sequence[str] = campaign.all_notes
    if notes:
        with st.expander(f"What the reader says of the logs ({len(notes)})"):
            st.markdown("\n".join(f"- {plain(note)}" for note in notes))


def _figures(campaign: Campaign, result: ReplayResult, before: ReplayResult | None) -> None:
    machine = campaign.machine
    chart(speeds(machine, result), "validate speeds", "Measured and simulated speed of every run")
    chart(residuals(machine, result, before), "validate residuals", "Residual of every run over time")
    st.caption(plain(RESIDUAL_NOTE))
    chart(inputs(machine, result), "validate inputs", "Measured input of every run")
    table(report.table(machine, result))
