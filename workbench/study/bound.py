"""How far references are from the least peak that any motion in the trapezoid's time has, each followed exactly."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from workbench.errors import InputError
from workbench.kinds import Load, kind_of, load_of
from workbench.metrics import set_of
from workbench.references import BASELINE, LimitPair, Shape, move_shape, planned_kind, planned_kinds
from workbench.references.optimal import GIVEN_AWAY, least_peak_move
from workbench.references.response import peak_force_n
from workbench.study.grid import RunSpec
from workbench.study.labels import listed, words_of
from workbench.study.load import Study
from workbench.study.run import peak_limit
from workbench.study.side import at_heaviest

FREE, EQUAL = "ruckig_least_peak", "ruckig_equal_time"
SAME = 0.005  # relative: limits and peaks that are alike
Moves = Sequence[Shape]


def from_the_bound(study: Study) -> list[str]:
    """At the heaviest payload the least peak in the trapezoid's time, how far the study's planned references are above
    it, and which pair of limits is free in that time. [] without a trapezoid, with jogs or a stop on the way, and
    where the load is not known or goes with its angle."""
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
        best = [
            least_peak_move(d, own.limits.towards(d).speed_m_s, shape.duration_s, load)
            for d, shape in zip(distances, moves[BASELINE], strict=True)
        ]
    except InputError:
        return [f"No motion in the {BASELINE}'s time{where} keeps to {asked.word}, speed and a taut wire."]
    least = asked.peak(best) / (1.0 + GIVEN_AWAY)
    away = [(100.0 * (asked.peak(own_moves) / least - 1.0), name) for name, own_moves in moves.items()]
    beside = "pin" if kind_of(own.machine).name == "hoist" else "viscous"
    said = (
        f"Followed exactly, no motion in the {BASELINE}'s time{where} has a {asked.word} peak below "
        f"{asked.said(least)}, {beside} friction and the loop's errors left out."
    )
    for side, chosen in (("Above", [a for a in away if a[0] >= 0.0]), ("Below", [a for a in away if a[0] < 0.0])):
        names = [
            f"{words_of(name)} by {abs(percent):.0f} %{_longer(moves[name], moves[BASELINE])}"
            for percent, name in chosen
        ]
        said += f" {side} it {'is' if len(names) == 1 else 'are'} {listed(names)}." if names else ""
    return [said, *_free_pair(moves, distances, own.limits, asked)]


@dataclass(frozen=True)
class _Asked:
    """What motions ask of the drive, in the unit of the study's tables: of a hoist one motor's torque."""

    spec: RunSpec
    load: Load

    @property
    def word(self) -> str:
        return set_of(kind_of(self.spec.machine).name).input_words

    def peak(self, moves: Moves) -> float:
        limit, of_load = peak_limit(self.spec.machine), self.load.force_limit_n
        scale = limit / of_load if math.isfinite(of_load) else 1.0
        return scale * max(peak_force_n(shape, self.load) for shape in moves)

    def said(self, peak: float) -> str:
        judged = set_of(kind_of(self.spec.machine).name)
        return f"{judged.by_name[judged.peak].text(peak)} {judged.input_unit}"


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
    """Where the study takes one of the pairs of acceleration and jerk that give the trapezoid's time: which are free,
    and which has the least peak."""
    if not {EQUAL, FREE} & set(moves):
        return []
    unit = kind_of(asked.spec.machine).moved.unit
    pairs = []
    for name in (EQUAL, FREE):
        own = moves.get(name) or _moves(name, distances, limits, asked.load)
        a, j = own[0].limits.acceleration_m_s2, own[0].limits.jerk_m_s3
        pairs.append(f"{a:.3g} {unit}/s² and {_short(j)} {unit}/s³ ({asked.said(asked.peak(own))})")
    trapezoid = limits.towards(distances[0]).acceleration_m_s2
    same = own[0].limits.acceleration_m_s2 < (1.0 + SAME) * trapezoid
    return [
        f"In that time the acceleration is free, and each has its jerk: {EQUAL} takes {pairs[0]}; of all pairs the "
        f"least peak is at {pairs[1]}{', the trapezoid but for its corners' if same else ''}."
    ]


def _short(value: float) -> str:
    return f"{value:.3g}" if value < 1000.0 else f"{float(f'{value:.3g}'):.0f}"
