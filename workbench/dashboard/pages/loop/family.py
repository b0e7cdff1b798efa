"""The loops behind the page Loop, kept by value, so that a slider that comes back costs nothing."""

from __future__ import annotations

import streamlit as st

from workbench.analysis.family import Member, family, operating_points
from workbench.analysis.linearise import Motion
from workbench.machine.files import machine_text
from workbench.reports.loop.case import LoopCaseFile


def loops(case: LoopCaseFile, motion: Motion) -> list[Member]:
    """Every payload at every height. InputError for a height off the rail."""
    said = machine_text(case.machine), case.settings.model_dump_json()
    return _loops(said, case.payloads_kg, case.heights_m, motion, case)


# A resource rather than data: the records are frozen, so that nobody need have a copy.
@st.cache_resource(max_entries=60, show_spinner=False)
def _loops(
    said: tuple[str, str],
    payloads_kg: tuple[float, ...],
    heights_m: tuple[float, ...],
    motion: Motion,
    _case: LoopCaseFile,
) -> list[Member]:
    points = operating_points(_case.machine, payloads_kg, heights_m, motion)
    return family(_case.machine, _case.settings, points)
