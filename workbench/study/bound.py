"""How far references are from the least peak that there is in the trapezoid's time, each followed exactly."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from workbench.core.errors import InputError
from workbench.machines import Load, kind_of, load_of
from workbench.metrics import set_of
from workbench.references import BASELINE, LimitPair, Shape, move_shape, planned_kind, planned_kinds
from workbench.references.least_peak import least_peak, peak_force_n
from workbench.references.limits import raised
from workbench.study.grid import RunSpec
from workbench.study.labels import listed, words_of
from workbench.study.load import Study
from workbench.study.run import peak_limit
from workbench.study.side import at_heaviest

FREE, EQUAL = "ruckig_least_peak", "ruckig_equal_time"
SAME = 0.005  # relative: limits and peaks that are alike
Moves = Sequence[Shape]


def from_the_bound(study: Study) -> list[str]:
    """At the heaviest payload the least peak in the trapezoid's time, from below and from above, how far the study's
    planned references are from it, and which pair of limits is free in that time. [] without a trapezoid, with jogs or
    a stop on the way, and where the load is not known or goes with its angle."""
    specs = {spec.reference: spec for spec in at_heaviest(study)}
    own = specs.get(BASELINE)
    load = None if own is None else load_of(own.machine, own.payload_kg)
    if own is None or own.limits is None or load is None or own.events.emergency_stop_s is not None:
        return []
    distances = _distances(own)
    if not distances:
        return []
    asked = _Asked(own, load)
    moves = {name: _moves(name, distances, own.limits, load) for name in specs if name in planned_kinds()}
    where = f" at {own.payload_kg:g} kg" if set_of(kind_of(own.machine).name).payload else ""
    try:
        still, any_end = (
            [
                least_peak(d, own.limits.towards(d).speed_m_s, shape.duration_s, load, still)
                for d, shape in zip(distances, moves[BASELINE], strict=True)
            ]
            for still in (True, False)
        )
    except InputError:
        return [f"No motion in the {BASELINE}'s time{where} keeps to {asked.word}, speed and a taut wire."]
    least, found, least_of_all = (
        asked.scale * max(forces)
        for forces in ([b.dual_n for b in still], [b.primal_n for b in still], [b.dual_n for b in any_end])
    )
    away = [(100.0 * (asked.peak(own_moves) / least - 1.0), name) for name, own_moves in moves.items()]
    beside = "pin" if kind_of(own.machine).name == "hoist" else "viscous"
    said = (
        f"Followed exactly, no motion in the {BASELINE}'s time{where} has a {asked.word} peak below "
        f"{_down(least_of_all)} {asked.unit}, and none that leaves the load at rest one below {_down(least)} "
        f"{asked.unit} (one has {-_down(-found)} {asked.unit}); {beside} friction and the loop's errors are left out."
    )
    for side, chosen in (("Above", [a for a in away if a[0] >= 0.0]), ("Below", [a for a in away if a[0] < 0.0])):
        names = [
            f"{words_of(name)} by {abs(percent):.0f} %{_longer(moves[name], moves[BASELINE])}"
            for percent, name in chosen
        ]
        said += (
            f" {side} {_down(least)} {asked.unit} {'is' if len(names) == 1 else 'are'} {listed(names)}."
            if names
            else ""
        )
    return [said, *_free_pair(moves, distances, own.limits, asked)]


@dataclass(frozen=True)
class _Asked:
    """What motions ask of the drive, in the unit of the study's tables: of a hoist one motor's torque."""

    spec: RunSpec
    load: Load

    @property
    def word(self) -> str:
        return set_of(kind_of(self.spec.machine).name).input_words

    @property
    def scale(self) -> float:
        """Of a force at the load."""
        limit, of_load = peak_limit(self.spec.machine), self.load.force_limit_n
        return limit / of_load if math.isfinite(of_load) else 1.0

    def peak(self, moves: Moves) -> float:
        return self.scale * max(peak_force_n(shape, self.load) for shape in moves)

    @property
    def unit(self) -> str:
        return set_of(kind_of(self.spec.machine).name).input_unit

    def said(self, peak: float) -> str:
        judged = set_of(kind_of(self.spec.machine).name)
        return f"{judged.by_name[judged.peak].text(peak)} {self.unit}"


def _down(value: float) -> float:
    """To four digits, never up: a bound stays one."""
    unit = 10.0 ** (math.floor(math.log10(abs(value))) - 3)
    return round(math.floor(value / unit) * unit, 12)


def _distances(spec: RunSpec) -> list[float]:
    """Of the moves from rest to rest; [] where there is a jog."""
    here, distances = spec.start_position_m, []
    for step in spec.moves:
        if step.speed_m_s is not None:
            return []
        if step.dwell_s is None:
            target = here + step.by_m if step.by_m is not None else step.to_m
            assert target is not None
            distances.append(target - here)
            here = target
    return list(dict.fromkeys(distances))


def _moves(name: str, distances: Sequence[float], limits: LimitPair, load: Load) -> Moves:
    return [move_shape(planned_kind(name), d, limits.towards(d), load) for d in distances]


def _longer(moves: Moves, base: Moves) -> str:
    more = sum(shape.duration_s for shape in moves) - sum(shape.duration_s for shape in base)
    return f" ({abs(more):.2g} s {'longer' if more > 0.0 else 'shorter'})" if abs(more) > 1e-3 else ""


def _free_pair(moves: Mapping[str, Moves], distances: Sequence[float], limits: LimitPair, asked: _Asked) -> list[str]:
    """Where the study takes a jerk-limited move in the trapezoid's time: which limit that exceeds and by how much, and
    of all pairs of acceleration and jerk at the speed limit the one of the least peak."""
    if not {EQUAL, FREE} & set(moves):
        return []
    unit = kind_of(asked.spec.machine).moved.unit
    equal, free = (moves.get(name) or _moves(name, distances, limits, asked.load) for name in (EQUAL, FREE))
    own, used, top = limits.towards(distances[0]), equal[0].limits, asked.load.top_speed_m_s
    exceeded = raised(own, used, unit) or "no limit"
    if top > 0.0 and used.speed_m_s > own.speed_m_s:
        exceeded += f" ({100.0 * used.speed_m_s / top:.3g} % of the drive's top speed)"
    best = free[0].limits
    same = best.acceleration_m_s2 < (1.0 + SAME) * own.acceleration_m_s2
    return [
        f"To keep that time {EQUAL} exceeds {exceeded}: {asked.said(asked.peak(equal))}. Of all pairs of acceleration "
        f"and jerk at {own.speed_m_s:.3g} {unit}/s the least peak is at "
        f"{best.acceleration_m_s2:.3g} {unit}/s² and {_short(best.jerk_m_s3)} {unit}/s³, {asked.said(asked.peak(free))}"
        f"{', the trapezoid but for its corners' if same else ''}."
    ]


def _short(value: float) -> str:
    return f"{value:.3g}" if value < 1000.0 else f"{float(f'{value:.3g}'):.0f}"
