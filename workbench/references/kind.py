"""Kinds of references: how one is declared, and all that there are: the library's, of entry points, added ones.

A kind that is planned is a function from a move to its shape, under `@planned(...)`:

    @planned(
        label="trapezoid", words="the trapezoid", definition="constant acceleration, speed and deceleration",
        ramp=ramp_of_a_trapezoid, needs_jerk=False, colour="#D55E00",
    )
    def trapezoid(move: Move) -> Shape:
        return shortest_move(move.distance_m, move.limits.without_jerk_limit())

Its name is the function's. Scenario files, their schema, errors, studies, sentences, tables, figures, the dashboard
and docs/references.md read the declaration; nothing else has to be edited for a new one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from workbench.core.declared import digest_of, library, of_entry_points
from workbench.core.errors import InputError, nearest
from workbench.machines import Load
from workbench.references.shape import Limits, Shape


@dataclass(frozen=True)
class Move:
    """A move from rest to rest, to be planned.

    distance_m: up positive. time_s: what the kind named by `same_time_as` takes for it; NaN without one. load: of the
    machine, for the kinds that declare `needs_load`.
    """

    distance_m: float
    limits: Limits
    time_s: float = math.nan
    load: Load | None = None

    @property
    def known_load(self) -> Load:
        """The load of a kind that declares `needs_load`."""
        assert self.load is not None
        return self.load


@dataclass(frozen=True)
class Ramp:
    """A change from one steady speed to another, to be planned: part of a jog. Up positive.

    time_s: what the kind named by `same_time_as` takes for it; NaN without one.
    """

    speed_m_s: float
    next_speed_m_s: float
    limits: Limits
    time_s: float = math.nan
    load: Load | None = None


@dataclass(frozen=True, kw_only=True)
class ReferenceKind:
    """What every kind of reference declares.

    name: in scenario files and results. label: in legends and choices. definition: in docs/references.md.
    colour, dash: of its lines in figures, "" for a spare colour; the palette is that of Okabe and Ito.
    """

    name: str
    label: str
    definition: str
    colour: str = ""
    dash: str = "solid"


@dataclass(frozen=True, kw_only=True)
class PlannedKind(ReferenceKind):
    """A kind that is planned from moves and limits.

    move: the shape of a move from rest to rest. ramp: the shape of a change of speed, which a jog holds afterwards.
    duration: what a move takes (s) without its shape, where that is cheaper. same_time_as: the kind whose duration
    the functions get as `time_s`, "" for none. needs_load: the functions get the machine's `load`; uses_load: where it
    is known.
    needs_following: worth it only where the loop follows the load's own swing, by a feed-forward that knows it or
    because nothing swings. needs_jerk: a
    finite jerk limit is asked for. words: the subject of a sentence that compares it with the baseline. usual: a
    scenario that names no references runs it.
    """

    words: str
    move: Callable[[Move], Shape] = field(repr=False)
    ramp: Callable[[Ramp], Shape] = field(repr=False)
    duration: Callable[[Move], float] | None = field(default=None, repr=False)
    same_time_as: str = ""
    needs_jerk: bool = True
    needs_load: bool = False
    uses_load: bool = False
    needs_following: bool = False
    usual: bool = False

    def check(self, limits: Limits, load: Load | None = None) -> None:
        """InputError where a jerk limit is missing, or the machine that the kind has to know."""
        if self.needs_load and load is None:
            said = f"'{self.name}' is planned for a machine's load, which is not known here or goes with its angle"
            raise InputError(said, place="references")
        if self.needs_following and load is not None and not load.hangs and not load.rigid:
            raise InputError(
                f"'{self.name}' asks the load to be followed exactly, and no feed-forward of an axis knows its "
                "coupling; choose trapezoid, ruckig or a shaper such as zvd",
                place="references",
            )
        if self.needs_jerk and math.isinf(limits.jerk_m_s3):
            raise InputError(f"'{self.name}' needs a finite jerk limit; without one use 'trapezoid'", place="jerk_m_s3")


@dataclass(frozen=True, kw_only=True)
class RecordedKind(ReferenceKind):
    """A kind that follows a campaign's run. smoothed: the recorded speed is averaged over `smoothing_s`."""

    smoothed: bool = False


def planned(**declared: Any) -> Callable[[Callable[[Move], Shape]], PlannedKind]:
    """Declare the function below as a kind of reference; the keywords are `PlannedKind`'s."""

    def declare(move: Callable[[Move], Shape]) -> PlannedKind:
        return PlannedKind(**({"name": move.__name__} | declared), move=move)

    return declare


ENTRY_POINTS = "workbench.references"  # the group; each entry names a module that declares kinds
BASELINE = "trapezoid"  # the kind that studies compare the others with

_added: dict[str, ReferenceKind] = {}


@cache
def library_kinds() -> tuple[ReferenceKind, ...]:
    """The kinds of the package, in the order of modules and lines."""
    return tuple(library("workbench.references.library", ReferenceKind))


@cache
def _of_entry_points() -> tuple[ReferenceKind, ...]:
    return tuple(kind for _, kinds in of_entry_points(ENTRY_POINTS, ReferenceKind) for kind in kinds)


def add(*kinds: ReferenceKind) -> None:
    """Makes kinds known in this process. InputError where a name is taken."""
    for kind in kinds:
        if kind.name in by_name():
            raise InputError(f"the reference name '{kind.name}' is taken; choose another", place="references")
        _added[kind.name] = kind


def forget_added() -> None:
    """Takes the added kinds out again."""
    _added.clear()


def by_name() -> dict[str, ReferenceKind]:
    """name -> kind: planned ones in the library's order, recorded ones, those of others."""
    return {kind.name: kind for kind in (*library_kinds(), *_of_entry_points(), *_added.values())}


def planned_kinds() -> dict[str, PlannedKind]:
    """name -> kind, of those that are planned from moves and limits."""
    return {name: kind for name, kind in by_name().items() if isinstance(kind, PlannedKind)}


def recorded_kinds() -> dict[str, RecordedKind]:
    """name -> kind, of those that follow a campaign's run."""
    return {name: kind for name, kind in by_name().items() if isinstance(kind, RecordedKind)}


def usual_kinds() -> tuple[str, ...]:
    """The names that a scenario without `references` runs."""
    return tuple(name for name, kind in planned_kinds().items() if kind.usual)


def planned_kind(name: str) -> PlannedKind:
    """The planned kind of that name. InputError with the nearest one where there is none."""
    kinds = planned_kinds()
    if name in kinds:
        return kinds[name]
    if name in recorded_kinds():
        raise InputError(f"'{name}'; it takes a block with campaign and run", place="references")
    raise InputError(f"unknown reference '{name}'; {nearest(name, kinds)}", place="references")


def digests_of(names: Iterable[str]) -> dict[str, str]:
    """name -> digest of the text that declares it, of those kinds that are not the library's."""
    own, known = {kind.name for kind in library_kinds()}, planned_kinds()
    return {name: digest_of(known[name].move.__module__) for name in sorted(set(names) - own) if name in known}
