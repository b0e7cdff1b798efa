"""Runs kept side by side in this session: what Study hands to Compare.

keep(name, scenario, machine, result)   keeps a study's runs; returns the name they are listed under
kept()                                  name -> Kept, in the order they were kept
forget(name)
head(...)                               a study's name with the buttons that keep and save it
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import streamlit as st

from workbench.dashboard import session
from workbench.dashboard.widgets import plain
from workbench.machine import Axis, Hoist
from workbench.study.run import StudyResult
from workbench.study.scenario import Scenario

_KEY = "runs kept"
MOST = 8  # more lines than that are a tangle


@dataclass(frozen=True)
class Kept:
    """A study's runs with what they were run from. machine: as chosen, before the scenario's overrides."""

    name: str
    scenario: Scenario
    machine: Hoist | Axis
    result: StudyResult


def head(scenario: Scenario, machine: Hoist | Axis, result: StudyResult, files: Mapping[str, tuple[str, str]]) -> None:
    """A study's name, the button that keeps it for Compare, its files to save. files: button -> (file name, text)."""
    title, keeping, *saving = st.columns(
        [6.7 - 1.7 * len(files), 1.8, *(1.6 for _ in files)], vertical_alignment="center"
    )
    title.markdown(f"##### {plain(scenario.name)} · {plain(result.study.machine.name)}")
    known = is_kept(scenario, machine)
    if keeping.button(
        "Kept" if known else "Keep for Compare", disabled=known, width="stretch", key="study keep",
        icon=":material/check:" if known else ":material/compare_arrows:",
    ):  # fmt: skip
        keep(scenario.name, scenario, machine, result)
        st.rerun()
    for column, (words, (file, text)) in zip(saving, files.items(), strict=True):
        column.download_button(
            words, text, file_name=file, mime="application/yaml", icon=":material/download:", on_click="ignore",
            width="stretch", key=f"study {words}",
        )  # fmt: skip


def kept() -> dict[str, Kept]:
    return session.get(_KEY, dict, {})


def keep(name: str, scenario: Scenario, machine: Hoist | Axis, result: StudyResult) -> str:
    """Keeps the runs under the name, or under the name with a number where other runs have it."""
    known = kept()
    free, number = name, 2
    while free in known and (known[free].scenario, known[free].machine) != (scenario, machine):
        free, number = f"{name} ({number})", number + 1
    later = {**known, free: Kept(free, scenario, machine, result)}
    session.put(_KEY, dict(list(later.items())[-MOST:]))
    return free


def is_kept(scenario: Scenario, machine: Hoist | Axis) -> bool:
    return any((study.scenario, study.machine) == (scenario, machine) for study in kept().values())


def forget(name: str) -> None:
    session.put(_KEY, {known: runs for known, runs in kept().items() if known != name})
