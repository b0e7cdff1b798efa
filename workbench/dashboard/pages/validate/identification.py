"""Identification on the page Validate: error bars, the law of friction, and the machine to keep or download."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import streamlit as st

from workbench.dashboard import session
from workbench.dashboard.machines import keep_machine
from workbench.dashboard.pages.validate.replay import question
from workbench.dashboard.widgets import chart, plain, table
from workbench.figures.identify import Estimate, correlation_matrix, estimates
from workbench.identify.identify import Identification, identify
from workbench.logs import Campaign
from workbench.machine import Axis, Hoist
from workbench.machine.files import machine_text
from workbench.reports.identify import report
from workbench.reports.identify.page import friction
from workbench.reports.numbers import with_error
from workbench.study.labels import field_label

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

_FOUND = "validate identified"


def identification(campaign: Campaign) -> Identification:
    """Fits the campaign's machine; the result stays on the page until another question is asked."""
    identified = identify(campaign, date=datetime.now(UTC).isoformat(timespec="seconds"))
    session.put(_FOUND, (question(campaign), identified))
    return identified


def found_for(campaign: Campaign) -> Identification | None:
    """What was identified from just these runs and this machine, if it was."""
    known = session.get(_FOUND, tuple, ())
    return known[1] if known and known[0] == question(campaign) else None


def offer(identified: Identification) -> None:
    """Draws what was found and offers the machine."""
    head, keep, download = st.columns([3.0, 1.4, 1.4], vertical_alignment="center")
    head.markdown("##### Identified machine")
    name = f"identified from {identified.campaign.name}"
    # A callback runs before the page, whose lists of machines then hold it.
    keep.button(
        "Keep the machine", icon=":material/save:", width="stretch", key="validate keep",
        on_click=_keep, args=(name, identified.machine),
    )  # fmt: skip
    download.download_button(
        "machine.yaml", machine_text(identified.machine), file_name="machine.yaml", mime="application/yaml",
        icon=":material/download:", on_click="ignore", width="stretch", key="validate download",
    )  # fmt: skip
    left, right = st.columns([1.15, 1.0])
    with left:
        chart(_estimates(identified), "validate estimates", "Fitted values with error bars and tolerances")
    with right:
        law = friction(identified).update_layout(height=470, title_text="")
        chart(law, "validate friction", "Law of friction, nominal and identified, with the log's points")
    st.markdown(
        "\n".join(f"- {plain(sentence)}" for sentence in report.sentences(identified, "the page Gap names what"))
    )
    with st.expander("Values, standard errors, correlations"):
        table(report.table(identified.fit))
        names = [free.key for free in identified.fit.free]
        chart(correlation_matrix(names, identified.fit.correlation), "validate correlation", "Correlations of the fit")


def _keep(name: str, machine: Hoist | Axis) -> None:
    st.toast(f"Kept as {plain(keep_machine(name, machine))}", icon=":material/check:")


def _estimates(identified: Identification) -> Figure:
    """In tolerances where every value has one, as a hoist's usual fit does; else in per cent of the nominal value."""
    fit = identified.fit
    held = all(free.prior_std is not None for free in fit.free)
    shown = []
    for free, value, error in zip(fit.free, fit.value, fit.std_error, strict=True):
        if held:
            unit = free.scale * (free.prior_std or 1.0)
            # A logarithmic value moves by factors: its distance is that of the logarithms.
            shift = math.log(value / free.nominal) if free.logarithmic else value - free.nominal
            spread = error / value if free.logarithmic else error
        elif free.nominal:
            unit, shift, spread = 0.01 * abs(free.nominal), value - free.nominal, error
        else:
            continue
        name, said = _in_words(free.key, value, error)
        shown.append(Estimate(name, shift / unit, spread / unit, said))
    return estimates(shown, "tolerances" if held else "% of nominal", 1.0 if held else None)


def _in_words(key: str, value: float, error: float) -> tuple[str, str]:
    """What a value is called, and it with its error and unit."""
    label = field_label(f"machine.{key}")
    prefix, scale = ("G", 1e-9) if label.unit == "Pa" else ("", 1.0)
    words = label.words.replace("coulomb", "Coulomb").replace("youngs", "Young's")
    return words, f"{' ± '.join(with_error(scale * value, scale * error))} {prefix}{label.unit}".strip()
