"""Runs kept side by side in this session: what Study hands to Compare.

keep(name, scenario, machine, result)   keeps a study's runs; returns the name they are listed under
kept()                                  name -> Kept, in the order they were kept
forget(name)
"""

from __future__ import annotations

from dataclasses import dataclass

from workbench.dashboard import session
from workbench.machine import Hoist
from workbench.study.execute.run import StudyResult
from workbench.study.scenario.record import Scenario

_KEY = "runs kept"
MOST = 8  # more lines than that are a tangle


@dataclass(frozen=True)
class Kept:
    """A study's runs with what they were run from. machine: as chosen, before the scenario's overrides."""

    name: str
    scenario: Scenario
    machine: Hoist
    result: StudyResult


def kept() -> dict[str, Kept]:
    return session.get(_KEY, dict, {})


def keep(name: str, scenario: Scenario, machine: Hoist, result: StudyResult) -> str:
    """Keeps the runs under the name, or under the name with a number where other runs have it."""
    known = kept()
    free, number = name, 2
    while free in known and (known[free].scenario, known[free].machine) != (scenario, machine):
        free, number = f"{name} ({number})", number + 1
    later = {**known, free: Kept(free, scenario, machine, result)}
    session.put(_KEY, dict(list(later.items())[-MOST:]))
    return free


def is_kept(scenario: Scenario, machine: Hoist) -> bool:
    return any((study.scenario, study.machine) == (scenario, machine) for study in kept().values())


def forget(name: str) -> None:
    session.put(_KEY, {known: runs for known, runs in kept().items() if known != name})
