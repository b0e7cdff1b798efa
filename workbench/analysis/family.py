"""A loop over payloads and heights, and its weakest members."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from workbench.analysis.linearise import Motion, OperatingPoint
from workbench.analysis.loop import LinearLoop, linear_loop
from workbench.analysis.margins import Margins, margins
from workbench.control import PiSettings
from workbench.errors import InputError
from workbench.machine import Hoist
from workbench.plants import NO_EFFECTS, Effects


@dataclass(frozen=True, eq=False)
class Member:
    """One loop of a family with its margins."""

    loop: LinearLoop
    margins: Margins

    @property
    def point(self) -> OperatingPoint:
        return self.loop.point


def operating_points(
    machine: Hoist, payloads_kg: Sequence[float], heights_m: Sequence[float], motion: Motion = "hoisting"
) -> list[OperatingPoint]:
    """Every payload at every height. InputError for a height off the rail or where no free wire is left."""
    low, high, top = machine.rail.lowest_position_m, machine.highest_position_m, machine.wire.segment_length_m
    for height in heights_m:
        if not (low <= height <= high and height < top):
            raise InputError(
                f"{height:g} m is off the rail, which reaches from {low:g} m to {high:g} m", place="heights"
            )
    for payload in payloads_kg:
        if not 0.0 <= payload <= 1e6:
            raise InputError(f"{payload:g} kg, expected 0 to 1000000 kg", place="payloads")
    return [OperatingPoint(payload, height, motion) for payload in payloads_kg for height in heights_m]


def family(
    machine: Hoist,
    settings: PiSettings,
    points: Sequence[OperatingPoint],
    *,
    effects: Effects = NO_EFFECTS,
    effect_values: Mapping[str, float] | None = None,
) -> list[Member]:
    """The loop at each point, with its margins; `effects` beside the machine's own."""
    loops = [linear_loop(machine, settings, point, effects=effects, effect_values=effect_values) for point in points]
    return [Member(loop, margins(loop)) for loop in loops]


def weakest(members: Sequence[Member]) -> Member:
    """An unstable one if there is any, else the one of the largest Ms; among equal ones of the smallest disk margin."""
    return max(members, key=lambda m: (not m.margins.stable, round(m.margins.ms, 3), -m.margins.disk))
