"""A scenario made into runs, and looked over before any of them is run."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from workbench.errors import InputError
from workbench.kinds import kind_of, load_of
from workbench.machine import Axis, Hoist
from workbench.references import motion_time_s
from workbench.study.scenario.fields import Assigned, Fields, Parts
from workbench.study.scenario.record import Scenario
from workbench.study.variations.grid import GridAxis, place_of, sampled, swept
from workbench.study.variations.run_list import RunList
from workbench.study.variations.run_spec import Recording, check_speed

MOST_RUNS = 1_000_000
MOST_MOTIONS = 5_000  # motions whose times are reckoned one by one


def plan_runs(scenario: Scenario, machine: Hoist | Axis, recordings: Mapping[str, Recording] | None = None) -> RunList:
    """The runs of a scenario on its machine (overrides, drive and effects in it), checked without running any.

    Raises InputError, with the field or `sweep.<field>` as place, for an unknown field, a value that fits
    nowhere, lists of unequal length under zip, too many runs, and a motion that is possible in no run.
    """
    fields = Fields(scenario, machine)
    axes = (*swept(scenario, fields), *sampled(scenario, fields, machine))
    specs = RunList(fields, axes, recordings or {})
    if len(specs) > MOST_RUNS:
        place = "sweep" if scenario.sweep is not None else "sample"
        raise InputError(f"makes {len(specs):,} runs, expected at most {MOST_RUNS:,}", place=place)
    _check_values(axes, fields)
    return replace(specs, duration_s=_common_duration_s(specs))


def _check_values(axes: Sequence[GridAxis], fields: Fields) -> None:
    """Each value by itself, the rest as the file has it; of drawn ones the smallest and the largest."""
    for axis in axes:
        for column, name in enumerate(axis.names):
            if not axis.sampled:
                for k, point in enumerate(axis.values):
                    _try({name: point[column]}, fields, f"{place_of(name, len(axis.names) > 1)}[{k}]", name)
                continue
            drawn = np.array([point[column] for point in axis.values], dtype=float)
            for k in (int(np.argmin(drawn)), int(np.argmax(drawn))):
                own = fields.value(name) if axis.relative[column] else 1.0
                if own is not None:
                    _try({name: float(drawn[k]) * own}, fields, f"sample.values.{name}", name, f" (draw {k})")


def _try(assigned: Assigned, fields: Fields, place: str, name: str, note: str = "") -> None:
    try:
        fields.parts(assigned)
    except InputError as error:
        if error.place == name:
            raise InputError(error.problem + note, place=place) from error
        # Something else does not fit with it; other swept values may yet mend that.


def _common_duration_s(specs: RunList) -> float:
    """How long each run is: as the slowest of all motions.

    Up to 5,000 different motions are reckoned one by one, of more those at the ends of each axis; a run
    that should take longer still is longer. A value that no run can move with, and a motion that is
    possible in no run, are an InputError.
    """
    moving = [axis for axis in specs.axes if axis.moves]
    many = math.prod(map(len, moving)) > MOST_MOTIONS
    ends = [_ends(axis) if many else range(len(axis)) for axis in moving]
    longest, first = -math.inf, None
    works: list[set[int]] = [set() for _ in moving]
    errors: dict[tuple[int, int], InputError] = {}
    for at in itertools.product(*ends):
        try:
            parts = specs.motion_parts(zip(moving, at, strict=True))
        except InputError as error:  # does not fit with the file's own values; other swept ones may mend that
            first, parts = first or error, None
        try:
            longest = longest if parts is None else max(longest, _time_s(specs, parts))
        except InputError as error:
            first = first or error
            for i, k in enumerate(at):
                errors.setdefault((i, k), error)
            continue
        for done, k in zip(works, at, strict=True):
            done.add(k)
    if first is not None and longest == -math.inf:
        raise first
    for (i, k), why in sorted(errors.items(), key=lambda item: item[0]):
        axis = moving[i]
        if k not in works[i] and not axis.sampled:
            together = len(axis.names) > 1
            place = "sweep.zip" if together else f"{place_of(axis.names[0], False)}[{k}]"
            said = why.problem if why.place in axis.names or together else f"{why.place}: {why.problem}"
            raise InputError(said, place=place) from why
    # A slip of a zero would fill the memory: the longest sensible duty cycle is an hour.
    if longest > 3600.0:
        raise InputError(f"the moves take {longest:.0f} s, expected at most 3600 s", place="moves")
    return longest


def _time_s(specs: RunList, parts: Parts) -> float:
    scenario, machine = specs.scenario, parts.machine
    rail = kind_of(machine).looped.rail(machine)
    times = [r.time_s[-1] - r.time_s[0] + r.smoothing_s for r in specs.recordings.values()]
    if kinds := scenario.planned_kinds:
        if parts.limits is None or parts.start_position_m is None:
            start = f"start_position_{kind_of(machine).moved.unit}"
            raise InputError("is missing", place="limits" if parts.limits is None else start)
        check_speed(parts.limits, machine)
        # The heaviest load swings slowest, and what is shaped for it takes longest.
        payload = max(scenario.payloads_kg or (0.0,)) if parts.payload_kg is None else parts.payload_kg
        load = load_of(machine, payload)
        times.append(motion_time_s(kinds, parts.moves, parts.start_position_m, parts.limits, rail, load))
    return parts.lead_s + float(max(times)) + parts.settle_s


def _ends(axis: GridAxis) -> list[int]:
    """The points at which a field of the axis is smallest or largest."""
    points = {0, len(axis) - 1}
    for column in range(len(axis.names)):
        values = [point[column] for point in axis.values]
        if all(isinstance(value, float) for value in values):
            points |= {int(np.argmin(np.array(values))), int(np.argmax(np.array(values)))}
    return sorted(points)
