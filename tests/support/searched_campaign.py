"""Campaigns with the search of their gap done, among a few effects only: what the steps after it start from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace

from tests.support.simulated_campaign import simulated_campaign, true_machine
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.search import Search, SearchResult
from workbench.effects import find
from workbench.logs import Campaign, read_campaign
from workbench.machines import KINDS


def searched_in(folder: Path, effects: Sequence[str]) -> tuple[Campaign, SearchResult]:
    campaign = read_campaign(folder)
    problem = Problem(campaign.machine, campaign.runs)
    kind = problem.active.kind
    search = Search(problem, [find(effect, kind) for effect in effects])
    return campaign, search.exact(search.singles(), 1)


def simulated_search(
    folder: Path, truth: Mapping[str, Mapping[str, float]], effects: Sequence[str]
) -> tuple[Campaign, SearchResult]:
    """Of the simulated campaign with the effects `truth` at work, all else within its tolerances."""
    plain = true_machine({"guide.coulomb_hoisting_n": 6300.0, "guide.coulomb_lowering_n": 4300.0})
    machine = type(plain).model_validate(plain.model_dump() | {"effects": truth})
    return searched_in(simulated_campaign(folder, machine), effects)


# What a verdict asks of the problem where the fits are made.
AXIS = SimpleNamespace(machine=KINDS["axis-rotary"].example(), runs=(), logged=(), noise=0.1, inputs=1, struck=False)
