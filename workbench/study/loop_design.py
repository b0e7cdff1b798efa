"""What `loop` and `tune` are asked: machine, controller, payloads and heights, from options, files or a scenario."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from workbench.analysis.linearise import STIFFNESS_BY_LENGTH, Motion
from workbench.analysis.margins import Member, Weakest, family, operating_points, weakest
from workbench.analysis.tune import Candidate, Goal, Trial, Tuned, TuneProgress, Weights, motions, usual_trial
from workbench.analysis.tune import tune as search_gains
from workbench.analysis.usual import usual_heights, usual_settings
from workbench.control import SETTINGS, Events, Settings
from workbench.control.settings import read_settings
from workbench.core.errors import InputError
from workbench.core.shown import Shown
from workbench.effects import check
from workbench.machines import LOOPED, AnyKind, Machine, default_hoist, kind_of, load_machine, looped, of_kind
from workbench.machines.plant import NO_EFFECTS
from workbench.study.load import Study, load_study

USUAL_PAYLOADS_KG = (0.0, 4500.0, 9000.0)
MOST = 50  # members of a family
Numbers = Sequence[float] | None


@dataclass(frozen=True, eq=False)
class DesignCase:
    """A machine with its drive, a controller with its source, the family, and the study if there is one."""

    machine: AnyKind
    settings: Settings
    origin: str
    payloads_kg: tuple[float, ...]
    heights_m: tuple[float, ...]
    study: Study | None

    @property
    def events(self) -> Events:
        """The events of the scenario; none without a scenario."""
        return Events() if self.study is None else self.study.scenario.events

    def members(self, motion: Motion = "hoisting", free_length: bool = False) -> list[Member]:
        """The loop at every payload and height, free_length: on a wire that is stiffer the shorter it hangs free.
        InputError for a height off the rail."""
        points = operating_points(self.machine, self.payloads_kg, self.heights_m, motion)
        return family(self.machine, self.settings, points, effects=STIFFNESS_BY_LENGTH if free_length else NO_EFFECTS)

    def tuned(self, goal: Goal, weights: Weights, also: Sequence[str], tell: Callable[[TuneProgress], object]) -> Tuned:
        """The gains of that goal. InputError, with the reason, for one out of reach."""
        points = operating_points(self.machine, self.payloads_kg, self.heights_m)
        return search_gains(self.machine, self.settings, points, self.trial(), goal, weights, also=also, tell=tell)

    def trial(self) -> Trial:
        """The moves and events of the scenario under this family's payloads, or the usual moves."""
        if self.study is None:
            return usual_trial(self.machine, self.payloads_kg, self.settings.sample_time_s)
        dt, length, first = self.settings.sample_time_s, self.study.duration_s, self.study.specs[0]
        speeds, positions = motions(self.machine, self.study.plans, dt, length)
        start, events, step_s = first.start_position_m, first.events, first.step_s
        return Trial(self.machine, self.payloads_kg, start, speeds, events, step_s, positions)


@dataclass(frozen=True, eq=False, repr=False)
class LoopAnalysis(Shown):
    """The loop at every payload and height, with its margins. ms_limit: the bound on Ms that figures show."""

    case: DesignCase
    members: tuple[Member, ...]
    ms_limit: float

    @property
    def weakest(self) -> Weakest:
        """The smallest of each margin, with its loop; an unstable loop if there is any."""
        return weakest(self.members)

    @property
    def plant(self) -> Any:
        """Of the loop with the largest Ms: the sampled plant as a `control.StateSpace`; see `LinearLoop.plant_system`.
        Those of another loop: `members[0].loop.plant_system()` and `.systems()`."""
        return self.weakest.member["ms"].loop.plant_system()

    @property
    def open(self) -> Any:
        """Of the same loop: L as a `control.StateSpace`."""
        return self.weakest.member["ms"].loop.systems()[0]

    @property
    def closed(self) -> Any:
        """Of the same loop: references, load torque and noise to the outputs and the torque wanted."""
        return self.weakest.member["ms"].loop.systems()[2]


@dataclass(frozen=True, eq=False, repr=False)
class Tuning(Shown):
    """What was tuned, for which goal, and the outcome with all candidates."""

    case: DesignCase
    weights: Weights
    outcome: Tuned

    @property
    def controller(self) -> Settings:
        """The winner's settings, for scenarios, `simulate` and `loop`."""
        return self.outcome.winner.settings

    @property
    def winner(self) -> Candidate:
        return self.outcome.winner


def load_case(
    machine: Path | None, scenario: Path | None, controller: Path | None, payloads_kg: Numbers, heights_m: Numbers
) -> DesignCase:
    """InputError with file and place for input that cannot be read or does not fit."""
    known: Machine | None = None
    if machine is not None:
        read = load_machine(machine, check_effects=check)
        known = looped(read)
        if known is None:
            raise InputError(f"is {of_kind(read)}; a loop is analysed for {LOOPED}", file=machine)
    given = None if controller is None else read_settings(controller)
    return loop_case(known, given, payloads_kg, heights_m, scenario, f"of {controller}")


def loop_case(
    machine: Machine | None,
    controller: Settings | None,
    payloads_kg: Numbers,
    heights_m: Numbers,
    scenario: str | os.PathLike[str] | None,
    origin: str = "as given",
) -> DesignCase:
    """The case of these values. None: the value of the scenario, otherwise the default. origin: the controller's."""
    study: Study | None = None
    loads: Sequence[float] | None = None
    if scenario is not None:
        study = load_study(scenario)
        # What the scenario itself says; a sweep's or a sample's points go their own ways from there.
        if controller is None:
            controller, origin = study.scenario.controller, f"of {scenario}"
        machine = study.machine if machine is None else machine
        loads = sorted({spec.payload_kg for spec in study.specs[:200]})
    machine = default_hoist() if machine is None else machine
    settings, origin = usual_settings(machine) if controller is None else (controller, origin)
    kind = kind_of(machine)
    if not isinstance(settings, SETTINGS[kind.name]):
        wants = " and ".join(SETTINGS[kind.name].GAINS)
        raise InputError(
            f"the controller {origin} is of kind '{settings.kind}' with {' and '.join(settings.GAINS)}; "
            f"{of_kind(machine)} takes kind '{SETTINGS[kind.name].model_fields['kind'].default}' with {wants}",
            place="controller",
        )
    if loads is None:
        loads = USUAL_PAYLOADS_KG if kind.payload else (0.0,)
    wanted = tuple(loads if payloads_kg is None else payloads_kg)
    places = tuple(usual_heights(machine) if heights_m is None else heights_m)
    if len(wanted) * len(places) > MOST:
        raise InputError(f"{len(wanted)} payloads at {len(places)} heights, expected at most {MOST} loops in all")
    return DesignCase(machine, settings, origin, wanted, places, study)


def numbers(text: str, place: str) -> tuple[float, ...]:
    """The numbers of `0,4500,9000` in their order, without repetitions."""
    try:
        values = tuple(dict.fromkeys(float(part) for part in text.split(",")))
    except ValueError as error:
        raise InputError(f"'{text}', expected numbers with commas between, such as 0,4500,9000", place=place) from error
    if not all(math.isfinite(x) for x in values):
        raise InputError(f"'{text}', expected finite numbers", place=place)
    return values
