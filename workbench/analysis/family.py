"""A loop over payloads and heights, and the least of its margins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from workbench.analysis.linearise import Motion, OperatingPoint
from workbench.analysis.loop import LinearLoop, linear_loop
from workbench.analysis.margins import Margins, margins
from workbench.control import Settings
from workbench.core.errors import InputError
from workbench.machines import NO_EFFECTS, Axis, Effects, Hoist, kind_of, of_kind


@dataclass(frozen=True, eq=False)
class Member:
    """One loop of a family with its margins."""

    loop: LinearLoop
    margins: Margins

    @property
    def point(self) -> OperatingPoint:
        return self.loop.point


def operating_points(
    machine: Hoist | Axis, payloads_kg: Sequence[float], heights_m: Sequence[float], motion: Motion = "hoisting"
) -> list[OperatingPoint]:
    """Every payload at every height. InputError for a height off the rail or where no free wire is left."""
    kind = kind_of(machine)
    (low, high), top = kind.looped.rail(machine), kind.looped.top(machine)
    for height in heights_m:
        if not (low <= height <= high and height < top):
            raise InputError(
                f"{height:g} m is off the rail, which reaches from {low:g} m to {high:g} m", place="heights"
            )
    if not kind.payload and any(payloads_kg):
        raise InputError(f"{of_kind(machine)} carries no payload", place="payloads")
    for payload in payloads_kg:
        if not 0.0 <= payload <= 1e6:
            raise InputError(f"{payload:g} kg, expected 0 to 1000000 kg", place="payloads")
    return [OperatingPoint(payload, height, motion) for payload in payloads_kg for height in heights_m]


def family(
    machine: Hoist | Axis,
    settings: Settings,
    points: Sequence[OperatingPoint],
    *,
    effects: Effects = NO_EFFECTS,
) -> list[Member]:
    """The loop at each point, with its margins; `effects` beside the machine's own."""
    loops = [linear_loop(machine, settings, point, effects=effects) for point in points]
    return [Member(loop, margins(loop)) for loop in loops]


@dataclass(frozen=True, eq=False)
class Weakest:
    """The least of each margin over a family. member: name of a margin -> the member it is of.

    An unstable member leaves no margin: all is then that member's.
    """

    margins: Margins
    member: Mapping[str, Member]

    @property
    def point(self) -> OperatingPoint:
        """Of the member with the largest Ms."""
        return self.member["ms"].point


# Margin -> (whether the larger is the worse, what goes with it).
_MARGINS: dict[str, tuple[bool, tuple[str, ...]]] = {
    "gain_up": (False, ("gain_up_hz",)),
    "gain_down": (True, ("gain_down_hz",)),
    "phase_deg": (False, ("crossover_hz",)),
    "delay_s": (False, ()),
    "disk": (False, ()),
    "ms": (True, ("ms_hz",)),
    "mt": (True, ("mt_hz",)),
    "bandwidth_hz": (False, ()),
    "rejection_hz": (False, ()),
}


def weakest(members: Sequence[Member]) -> Weakest:
    """The least of each margin, each with its own member: least gain and largest Ms may stand at different payloads."""
    unstable = next((m for m in members if not m.margins.stable), None)
    if unstable is not None:
        return Weakest(unstable.margins, dict.fromkeys(_MARGINS, unstable))
    least: dict[str, Any] = {}
    of: dict[str, Member] = {}
    for name, (larger_is_worse, beside) in _MARGINS.items():
        values = [getattr(m.margins, name) for m in members]
        of[name] = members[values.index(max(values) if larger_is_worse else min(values))]
        least |= {key: getattr(of[name].margins, key) for key in (name, *beside)}
    return Weakest(replace(members[0].margins, **least), of)
