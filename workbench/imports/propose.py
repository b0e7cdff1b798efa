"""Which column of a log is which signal: by its unit, then by words that drives and PLCs use, English and German."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from workbench.errors import InputError, nearest
from workbench.imports.units import quantity_of, unit_of
from workbench.kinds import TIME, kind_of
from workbench.log_formats.rates import Channel
from workbench.machine import Axis, Hoist

# For each quantity words that speak for it; a set point is another signal than an actual value.
_WORDS = {
    "torque": r"torque|moment|drehmoment|\bm_?ist|m_act|trq",
    "turning": r"speed|drehzahl|velocity|omega|n_?ist|n_act|geschw|rpm",
    "speed": r"speed|velocity|geschw|v_?ist|v_act",
    "length": r"position|height|pos\b|pos_|hoehe|höhe|hub|lage|weg|carriage|schlitten|x_?ist",
    "angle": r"angle|winkel|position|phi",
    "force": r"tension|zug|seil|rope|wire|line|kraft|force|load ?cell|anchor|hook",
}
_WISHED = re.compile(r"soll|set ?point|setpoint|\bref|_ref|reference|cmd|command|target|wanted|demand", re.IGNORECASE)
_NOT = re.compile(r"error|fehler|abweich|deviation|limit|grenz|max|min\b|temp|status", re.IGNORECASE)
LEAST = 2  # of the score, that a proposal takes


@dataclass(frozen=True)
class Proposal:
    """signal = factor * column. others: columns that fit as well. guessed_unit: the file says none, SI is taken."""

    signal: str
    column: str
    unit: str
    factor: float
    others: tuple[str, ...] = ()
    guessed_unit: bool = False


@dataclass(frozen=True)
class Proposed:
    """A mapping. unused: columns that are no signal."""

    proposals: tuple[Proposal, ...]
    unused: tuple[str, ...]


def propose(machine: Hoist | Axis, channels: Sequence[Channel], mapped: Sequence[str] = ()) -> Proposed:
    """A mapping for the signals of the machine's kind; mapped: SIGNAL=COLUMN, taken as they are.

    InputError where a needed signal finds no column, with the columns there are, and for a name that there is not.
    """
    wanted = kind_of(machine).signals
    signals = [name for name in wanted.names if name != TIME]
    chosen = {signal: _proposal(signal, channel) for signal, channel in _mapped(mapped, signals, channels)}
    taken = {proposal.column for proposal in chosen.values()}
    left = [channel for channel in channels if channel.name not in taken]
    signals = [name for name in signals if name not in chosen]
    # Of a torque of each motor and of all together, those of each are looked for first.
    for signal in sorted(signals, key=lambda name: (_number(name) is None, signals.index(name))):
        ranked = sorted(
            ((score(signal, channel), -i, channel) for i, channel in enumerate(left)), key=lambda e: (-e[0], -e[1])
        )
        fitting = [(points, channel) for points, _, channel in ranked if points >= LEAST]
        if not fitting:
            continue
        points, best = fitting[0]
        alike = tuple(channel.name for other, channel in fitting[1:] if other == points)
        chosen[signal] = _proposal(signal, best, alike)
        left = [channel for channel in left if channel is not best]
    for group in wanted.needed:
        if not any(all(name == TIME or name in chosen for name in alternative) for alternative in group):
            needed = " or ".join(" and ".join(alternative) for alternative in group)
            columns = ", ".join(f"{c.name} [{c.unit}]" if c.unit else c.name for c in channels)
            raise InputError(f"no column looks like {needed}; the file has: {columns}")
    order = [name for name in wanted.names if name in chosen]
    return Proposed(tuple(chosen[name] for name in order), tuple(channel.name for channel in left))


def _proposal(signal: str, channel: Channel, others: tuple[str, ...] = ()) -> Proposal:
    known = unit_of(channel.unit)
    return Proposal(signal, channel.name, channel.unit, known[1] if known else 1.0, others, known is None)


def _mapped(words: Sequence[str], signals: Sequence[str], channels: Sequence[Channel]) -> list[tuple[str, Channel]]:
    named = {channel.name: channel for channel in channels}
    chosen = []
    for word in words:
        signal, mark, column = word.partition("=")
        if not mark:
            raise InputError(f"'{word}', expected SIGNAL=COLUMN", place="mapped")
        if signal not in signals:
            raise InputError(f"unknown signal '{signal}'; {nearest(signal, signals)}", place="mapped")
        if column not in named:
            raise InputError(f"no column '{column}'; {nearest(column, named)}", place="mapped")
        chosen.append((signal, named[column]))
    return chosen


def for_all(values: Sequence[float], files: int, place: str) -> list[float | None]:
    """What is said once for all files, or once for each; None where nothing is said."""
    if len(values) not in (0, 1, files):
        raise InputError(f"is given {len(values)} times for {files} files, expected once or for each", place=place)
    said: list[float | None] = [*values] if values else [None]
    return said if len(said) == files else said * files


def score(signal: str, channel: Channel) -> float:
    """How well a column fits a signal; 0 where its unit is another quantity's."""
    quantity, known = quantity_of(signal), unit_of(channel.unit)
    if known is not None and known[0] != quantity:
        return 0.0
    if channel.name == signal:
        return 100.0
    name = channel.name.lower()
    points = 2.0 if known is not None else 0.0
    points += 2.0 if re.search(_WORDS.get(quantity, r"$^"), name) else 0.0
    wished = bool(_WISHED.search(name))
    if wished != ("reference" in signal):
        return 0.0
    if _NOT.search(name):
        points -= 3.0
    number = _number(signal)
    if number is not None:
        numbers = re.findall(r"\d+", name)
        points += 1.0 if str(number) in numbers else -3.0
    elif re.search(r"motor_?\s?[12]\b|\b[12]$", name) and "torque" in signal:
        points -= 3.0
    return points


def _number(signal: str) -> int | None:
    motor = re.search(r"motor(\d)", signal)
    return int(motor.group(1)) if motor else None
