"""Which column of a log is which signal: by its unit, then by words that drives and PLCs use, English and German."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from workbench.core.errors import InputError, nearest
from workbench.logs.formats.declared import Channel
from workbench.machines import TIME, Axis, Hoist, kind_of

# unit, lower case and without blanks, dots and asterisks -> (quantity, factor to SI)
UNITS: Mapping[str, tuple[str, float]] = MappingProxyType(
    {
        "s": ("time", 1.0), "sec": ("time", 1.0), "ms": ("time", 1e-3), "µs": ("time", 1e-6), "us": ("time", 1e-6),
        "nm": ("torque", 1.0), "knm": ("torque", 1e3), "mnm": ("torque", 1e-3),
        "rad/s": ("turning", 1.0), "1/s": ("turning", 2.0 * math.pi), "deg/s": ("turning", math.pi / 180.0),
        "°/s": ("turning", math.pi / 180.0), "rpm": ("turning", math.pi / 30.0), "1/min": ("turning", math.pi / 30.0),
        "min-1": ("turning", math.pi / 30.0), "u/min": ("turning", math.pi / 30.0),
        "r/min": ("turning", math.pi / 30.0),
        "m": ("length", 1.0), "mm": ("length", 1e-3), "cm": ("length", 1e-2), "µm": ("length", 1e-6),
        "m/s": ("speed", 1.0), "mm/s": ("speed", 1e-3), "m/min": ("speed", 1.0 / 60.0),
        "mm/min": ("speed", 1e-3 / 60.0),
        "n": ("force", 1.0), "kn": ("force", 1e3), "dan": ("force", 10.0), "t": ("force", 9806.65),
        "rad": ("angle", 1.0), "deg": ("angle", math.pi / 180.0), "°": ("angle", math.pi / 180.0),
        "rev": ("angle", 2.0 * math.pi),
    }
)  # fmt: skip
# The ending of a signal's name -> the quantity that it is.
OF_SIGNALS: Mapping[str, str] = MappingProxyType(
    {
        "_rad_s": "turning",
        "_m_s": "speed",
        "_nm": "torque",
        "_rad": "angle",
        "_n": "force",
        "_m": "length",
        "_s": "time",
    }
)


def unit_of(text: str) -> tuple[str, float] | None:
    """(quantity, factor) of a unit as written; None where it is not known."""
    plain = text.strip().lower()
    for sign in (" ", "·", "*", "⋅"):
        plain = plain.replace(sign, "")
    return UNITS.get(plain)


def quantity_of(signal: str) -> str:
    """What a signal is, by the unit in its name."""
    ending = max((e for e in OF_SIGNALS if signal.endswith(e)), key=len)
    return OF_SIGNALS[ending]


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
NOMINAL = "%nominal"
PLAUSIBLE = (0.1, 3.0)  # times the nominal value: what a log of a machine at work reaches
UNSAID = ("rpm", "knm", "kn", "mm/s")  # units that logs often leave out, beside per cent of nominal
LEAST = 2  # of the score, that a proposal takes


@dataclass(frozen=True)
class Proposal:
    """signal = factor * column. others: columns that fit as well. guessed_unit: the file says none, SI is taken, or
    by_size, the unit in which the values are plausible."""

    signal: str
    column: str
    unit: str
    factor: float
    others: tuple[str, ...] = ()
    guessed_unit: bool = False
    by_size: str = ""


@dataclass(frozen=True)
class Proposed:
    """A mapping. unused: columns that are no signal."""

    proposals: tuple[Proposal, ...]
    unused: tuple[str, ...]


def propose(
    machine: Hoist | Axis, channels: Sequence[Channel], mapped: Sequence[str] = (), scales: Sequence[str] = ()
) -> Proposed:
    """A mapping for the signals of the machine's kind.

    mapped: SIGNAL=COLUMN or SIGNAL=COLUMN:UNIT, taken as they are; the unit is one of UNITS, or %nominal.
    scales: SIGNAL=FACTOR, signal = factor · column in SI.

    InputError where a needed signal finds no column, with the columns there are, and for a name that there is not.
    """
    wanted = kind_of(machine).signals
    signals = [name for name in wanted.names if name != TIME]
    chosen = {p.signal: p for p in _mapped(machine, mapped, signals, channels)}
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
        chosen[signal] = by_size(machine, _proposal(signal, best, alike), best)
        left = [channel for channel in left if channel is not best]
    for group in wanted.needed:
        if not any(all(name == TIME or name in chosen for name in alternative) for alternative in group):
            needed = " or ".join(" and ".join(alternative) for alternative in group)
            columns = ", ".join(f"{c.name} [{c.unit}]" if c.unit else c.name for c in channels)
            raise InputError(f"no column looks like {needed}; the file has: {columns}")
    for word in scales:
        signal, factor = _scale(word, chosen)
        chosen[signal] = replace(chosen[signal], factor=factor, guessed_unit=False)
    order = [name for name in wanted.names if name in chosen]
    return Proposed(tuple(chosen[name] for name in order), tuple(channel.name for channel in left))


def _proposal(signal: str, channel: Channel, others: tuple[str, ...] = ()) -> Proposal:
    known = unit_of(channel.unit)
    return Proposal(signal, channel.name, channel.unit, known[1] if known else 1.0, others, known is None)


def by_size(machine: Hoist | Axis, proposal: Proposal, channel: Channel) -> Proposal:
    """The proposal in the one unit in which the column's values are what the machine does, where the file names none
    and SI is not that: 99 % of them within PLAUSIBLE, in nominal torque, force or speed."""
    if not proposal.guessed_unit or not np.isfinite(channel.values).any():
        return proposal
    try:
        nominal = _nominal(machine, proposal.signal)
    except InputError:
        return proposal
    size = float(np.nanquantile(np.abs(channel.values), 0.99)) / nominal
    quantity = quantity_of(proposal.signal)
    factors = {unit: UNITS[unit][1] for unit in UNSAID if UNITS[unit][0] == quantity}
    factors |= {NOMINAL: nominal / 100.0, "": 1.0}
    fitting = {factor: unit for unit, factor in factors.items() if PLAUSIBLE[0] <= factor * size <= PLAUSIBLE[1]}
    if 1.0 in fitting or len(fitting) != 1:
        return proposal
    ((factor, unit),) = fitting.items()
    return replace(proposal, factor=factor, by_size=unit)


def _mapped(
    machine: Hoist | Axis, words: Sequence[str], signals: Sequence[str], channels: Sequence[Channel]
) -> list[Proposal]:
    named = {channel.name: channel for channel in channels}
    chosen = []
    for word in words:
        signal, mark, column = word.partition("=")
        if not mark:
            raise InputError(f"'{word}', expected SIGNAL=COLUMN or SIGNAL=COLUMN:UNIT", place="mapped")
        if signal not in signals:
            raise InputError(f"unknown signal '{signal}'; {nearest(signal, signals)}", place="mapped")
        unit = ""
        if column not in named and ":" in column:
            column, _, unit = column.rpartition(":")
        if column not in named:
            raise InputError(f"no column '{column}'; {nearest(column, named)}", place="mapped")
        proposal = _proposal(signal, named[column])
        if unit:
            proposal = replace(proposal, factor=_factor(machine, signal, unit), guessed_unit=False)
        chosen.append(proposal)
    return chosen


def _factor(machine: Hoist | Axis, signal: str, unit: str) -> float:
    """To SI, of a unit that the user names for a signal."""
    if unit.replace(" ", "") == NOMINAL:
        return _nominal(machine, signal) / 100.0
    known, quantity = unit_of(unit), quantity_of(signal)
    if known is None or known[0] != quantity:
        valid = [name for name, (of, _) in UNITS.items() if of == quantity] + [NOMINAL]
        raise InputError(f"'{unit}' is no unit of {signal}; {nearest(unit.lower(), valid)}", place="mapped")
    return known[1]


def _nominal(machine: Hoist | Axis, signal: str) -> float:
    """What a signal is given in per cent of, SI: one motor's torque, all motors', the drive's force, or the speed."""
    kind = kind_of(machine)
    limits = kind.limits(machine) if kind.limits is not None else None
    value: float | None = None
    if signal in kind.drive.parts and kind.motor_torque is not None:
        value = kind.motor_torque(machine)
    elif signal == kind.plant.input:
        value = limits.nominal_input if limits is not None else getattr(machine.drive, "nominal", None)
    elif quantity_of(signal) == quantity_of(kind.plant.speeds[0]):
        value = limits.nominal_speed if limits is not None else getattr(machine.drive, "top_speed", None)
    if not value:
        raise InputError(f"machine.yaml states no nominal value of {signal}; give its scale", place="mapped")
    return float(value)


def _scale(word: str, chosen: Mapping[str, Proposal]) -> tuple[str, float]:
    signal, _, text = word.partition("=")
    if signal not in chosen:
        raise InputError(f"unknown or unmapped signal '{signal}'; {nearest(signal, chosen)}", place="scales")
    try:
        factor = float(text)
    except ValueError:
        factor = 0.0
    if factor == 0.0 or not math.isfinite(factor):
        raise InputError(f"'{word}', expected SIGNAL=FACTOR with a finite number other than 0", place="scales")
    return signal, factor


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
