"""Logs as drives write them, made a campaign: which column is which signal, each log as Parquet, runs.yaml.

A column is found by its unit, then by words that drives and PLCs use, English and German.
"""

from __future__ import annotations

import csv
import math
import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from workbench.core.errors import InputError, check_known, nearest
from workbench.core.input_file import read_input
from workbench.core.names import unit_of as unit_in
from workbench.core.run import Array
from workbench.core.whole_folder import whole_folder
from workbench.core.yaml_strict import dumps
from workbench.logs import Campaign, read_campaign
from workbench.logs.formats.declared import TIME, Channel, at_times, distinct, fastest, titled
from workbench.logs.formats.drive_csv import TIME_UNITS, read_drive_csv, split_unit
from workbench.logs.formats.opening import open_log
from workbench.machines import Hoist, Machine, kind_of, load_of

# unit, lower case and without blanks, dots and asterisks -> (quantity, factor to SI)
UNITS: Mapping[str, tuple[str, float]] = {
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
}  # fmt: skip


def unit_of(text: str) -> tuple[str, float] | None:
    """(quantity, factor) of a unit as written; None where it is not known."""
    plain = text.strip().lower()
    for sign in (" ", "·", "*", "⋅"):
        plain = plain.replace(sign, "")
    return UNITS.get(plain)


def quantity_of(signal: str) -> str:
    """What a signal is, by the unit in its name."""
    known = unit_of(unit_in(signal))
    assert known is not None
    return known[0]


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
POSSIBLE = (0.01, 3.0)  # times the nominal value: what a log of a machine at work reaches
HELD = 0.7  # of the torque that holds an empty hoist
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
    machine: Machine, channels: Sequence[Channel], mapped: Sequence[str] = (), scales: Sequence[str] = ()
) -> Proposed:
    """A mapping for the signals of the machine's kind.

    mapped: SIGNAL=COLUMN or SIGNAL=COLUMN:UNIT, taken as they are; the unit is one of UNITS, or %nominal.
    scales: SIGNAL=FACTOR, signal = factor · column in SI.

    InputError where a needed signal finds no column, with the columns there are, and for a name that there is not.
    """
    wanted = kind_of(machine).signals
    signals = [name for name in wanted.names if name != TIME]
    chosen = {p.signal: p for p in (_mapped(machine, word, signals, channels) for word in mapped)}
    taken = {proposal.column for proposal in chosen.values()}
    left = [channel for channel in channels if channel.name not in taken]
    signals = [name for name in signals if name not in chosen]
    # Of a torque of each motor and of all together, those of each are looked for first.
    for signal in sorted(signals, key=lambda name: (_number(name) is None, signals.index(name))):
        scored = [(score(signal, channel), channel) for channel in left]
        points, best = max(scored, key=lambda one: one[0], default=(0.0, None))
        if best is None or points < LEAST:
            continue
        left.remove(best)
        alike = tuple(channel.name for other, channel in scored if other == points and channel is not best)
        chosen[signal] = by_size(machine, _proposal(signal, best, alike), best)
    for group in wanted.needed:
        if not any(all(name == TIME or name in chosen for name in alternative) for alternative in group):
            needed = " or ".join(" and ".join(alternative) for alternative in group)
            columns = ", ".join(titled(channel.name, channel.unit) for channel in channels)
            raise InputError(f"no column looks like {needed}; the file has: {columns}")
    for word in scales:
        signal, _, text = word.partition("=")
        check_known("unknown or unmapped signal", signal, chosen, place="scales")
        try:
            factor = float(text)
        except ValueError:
            factor = 0.0
        if factor == 0.0 or not math.isfinite(factor):
            raise InputError(f"'{word}', expected SIGNAL=FACTOR with a finite number other than 0", place="scales")
        chosen[signal] = replace(chosen[signal], factor=factor, guessed_unit=False)
    ordered = tuple(chosen[name] for name in wanted.names if name in chosen)
    return Proposed(ordered, tuple(channel.name for channel in left))


def _proposal(signal: str, channel: Channel, others: tuple[str, ...] = ()) -> Proposal:
    known = unit_of(channel.unit)
    return Proposal(signal, channel.name, channel.unit, known[1] if known else 1.0, others, known is None)


def by_size(machine: Machine, proposal: Proposal, channel: Channel) -> Proposal:
    """The proposal in the only unit in which the column's values are what the machine can do, where the file names
    none and SI is not that: 99 % of them within POSSIBLE, in nominal torque, force or speed; a hoist's torque holds the
    empty carriage at least, but for HELD of it."""
    nominal = _nominal(machine, proposal.signal)
    if not proposal.guessed_unit or not nominal or not np.isfinite(channel.values).any():
        return proposal
    size = float(np.nanquantile(np.abs(channel.values), 0.99)) / nominal
    quantity = quantity_of(proposal.signal)
    factors = {unit: UNITS[unit][1] for unit in UNSAID if UNITS[unit][0] == quantity}
    factors |= {NOMINAL: nominal / 100.0, "": 1.0}
    least = POSSIBLE[0]
    if quantity == "torque" and isinstance(machine, Hoist) and (load := load_of(machine, 0.0)) is not None:
        least = HELD * load.hold_n * machine.lift_m_per_rad / _nominal(machine, kind_of(machine).plant.input)
    fitting = [unit for unit, factor in factors.items() if least <= factor * size <= POSSIBLE[1]]
    if "" in fitting or len(fitting) != 1:
        return proposal
    return replace(proposal, factor=factors[fitting[0]], by_size=fitting[0])


def _mapped(machine: Machine, word: str, signals: Sequence[str], channels: Sequence[Channel]) -> Proposal:
    """What a user maps. InputError for a signal, column or unit that there is not."""
    named = {channel.name: channel for channel in channels}
    signal, mark, column = word.partition("=")
    if not mark:
        raise InputError(f"'{word}', expected SIGNAL=COLUMN or SIGNAL=COLUMN:UNIT", place="mapped")
    check_known("unknown signal", signal, signals, place="mapped")
    unit = ""
    if column not in named and ":" in column:
        column, _, unit = column.rpartition(":")
    check_known("no column", column, named, place="mapped")
    proposal, known, quantity = _proposal(signal, named[column]), unit_of(unit), quantity_of(signal)
    if not unit:
        return proposal
    if unit.replace(" ", "") == NOMINAL:
        if not (nominal := _nominal(machine, signal)):
            raise InputError(f"machine.yaml states no nominal value of {signal}; give its scale", place="mapped")
        return replace(proposal, factor=nominal / 100.0, guessed_unit=False)
    if known is None or known[0] != quantity:
        valid = [name for name, (of, _) in UNITS.items() if of == quantity] + [NOMINAL]
        raise InputError(f"'{unit}' is no unit of {signal}; {nearest(unit.lower(), valid)}", place="mapped")
    return replace(proposal, factor=known[1], guessed_unit=False)


def _nominal(machine: Machine, signal: str) -> float:
    """What a signal is given in per cent of, SI: one motor's torque, all motors', the drive's force, or the speed; 0
    where machine.yaml states none."""
    kind = kind_of(machine)
    limits = kind.limits(machine) if kind.limits is not None else None
    drive = None if limits is not None else machine.drive
    value: float | None = None
    if signal in kind.drive.parts and kind.motor_torque is not None:
        value = kind.motor_torque(machine)
    elif signal == kind.plant.input:
        value = getattr(drive, "nominal", None) if limits is None else limits.nominal_input
    elif quantity_of(signal) == quantity_of(kind.plant.speeds[0]):
        value = getattr(drive, "top_speed", None) if limits is None else limits.nominal_speed
    return float(value or 0.0)


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
    name, number = channel.name.lower(), _number(signal)
    if bool(_WISHED.search(name)) != ("reference" in signal):
        return 0.0
    points = 2.0 * (known is not None) + 2.0 * bool(re.search(_WORDS.get(quantity, r"$^"), name))
    points -= 3.0 * bool(_NOT.search(name))
    if number is not None:
        points += 1.0 if str(number) in re.findall(r"\d+", name) else -3.0
    elif re.search(r"motor_?\s?[12]\b|\b[12]$", name) and "torque" in signal:
        points -= 3.0
    return points


def _number(signal: str) -> int | None:
    motor = re.search(r"motor(\d)", signal)
    return int(motor.group(1)) if motor else None


# Files


TEXT = (".csv", ".txt", ".tsv", ".asc")
_TIMES = ("time", "t", "zeit", "timestamp", TIME)


def read_channels(file: Path) -> list[Channel]:
    """InputError for a file that is not there, not read, or holds no channels over a time."""
    problem = f"no column is a time; expected one named {', '.join(_TIMES)}"
    if file.suffix.lower() in TEXT:
        channels = read_drive_csv(file)
        if any(len(channel.time_s) and np.isnan(channel.time_s).all() for channel in channels):
            raise InputError(problem, file=file)
        return channels
    with open_log(file) as log:
        table = log.read(log.names)
    titles = {name: split_unit(name) for name in log.names}
    time = next((name for name, (plain, _) in titles.items() if plain.lower() in _TIMES), None)
    if time is None:
        raise InputError(problem, file=file)
    time_s = TIME_UNITS.get(titles[time][1].lower(), 1.0) * table[time]
    return [Channel(plain, unit, time_s, table[name]) for name, (plain, unit) in titles.items() if name != time]


@dataclass(frozen=True)
class Imported:
    """One file with what is said of its run."""

    file: Path
    channels: tuple[Channel, ...]
    payload_kg: float | None = None
    start_position_m: float | None = None
    start_time_s: float | None = None

    @property
    def name(self) -> str:
        return self.file.stem

    def columns(self) -> dict[str, Array]:
        """All channels by title, at the times of the fastest; `time_s` counts from its first sample."""
        time_s = fastest(self.channels)
        titles = distinct([titled(channel.name, channel.unit) for channel in self.channels])
        columns = {title: at_times(c, time_s) for title, c in zip(titles, self.channels, strict=True)}
        return {TIME: time_s - time_s[0], **columns}


SAID = ("payload_kg", "start_position_m", "start_time_s")


def with_table(logs: Sequence[Imported], file: Path) -> list[Imported]:
    """The logs with what a table says of each: a row a file, by its name with or without ending; empty cells say
    nothing. InputError names the line."""
    text = read_input(file, "settings").decode("utf-8-sig", errors="replace")
    rows = csv.DictReader(text.splitlines(), restkey="beyond the header")
    columns = [name.strip() for name in rows.fieldnames or ()]
    rows.fieldnames = columns
    if odd := [name for name in columns if name not in ("file", *SAID)] or (["file"] if "file" not in columns else []):
        raise InputError(f"column '{odd[0]}', expected file and any of {', '.join(SAID)}", file=file, line=1)
    said: dict[str, dict[str, Any]] = {}
    names = {name for log in logs for name in (log.file.name, log.name)}
    for row in rows:
        name = Path(row["file"] or "").name
        if name not in names:
            raise InputError(f"no log '{name}' is imported; {nearest(name, names)}", file=file, line=rows.line_num)
        try:
            said[Path(name).stem] = {key: float(row[key]) for key in SAID if (row.get(key) or "").strip()}
        except ValueError as error:
            raise InputError(f"{error}; expected numbers", file=file, line=rows.line_num) from error
    return [replace(log, **said.get(log.name, {})) for log in logs]


def in_si(proposal: Proposal, imported: Imported) -> tuple[Array, Array]:
    """Times (n,), s, and values (n,), SI, of a proposed signal at its own samples."""
    channel = next(c for c in imported.channels if c.name == proposal.column)
    return channel.time_s - fastest(imported.channels)[0], proposal.factor * channel.values


def write_campaign(machine: Path, logs: Sequence[Imported], proposed: Proposed, folder: Path) -> Campaign:
    """Writes the folder whole or not at all, and returns it as it is read back. InputError where it cannot be read as a
    campaign: then nothing is written."""
    import pyarrow as pa
    import pyarrow.parquet

    names = [log.name for log in logs]
    if len(set(names)) < len(names):
        raise InputError(f"two files are called {next(n for n in names if names.count(n) > 1)}; rename one")
    with whole_folder(folder) as hidden:
        (hidden / "runs").mkdir()
        shutil.copyfile(machine, hidden / "machine.yaml")
        for log in logs:
            arrays = {name: pa.array(values, mask=np.isnan(values)) for name, values in log.columns().items()}
            pyarrow.parquet.write_table(pa.table(arrays), hidden / "runs" / f"{log.name}.parquet")
        (hidden / "runs.yaml").write_text(runs_yaml(logs, proposed), encoding="utf-8")
        try:
            campaign = read_campaign(hidden)
        except InputError as error:
            place = error.place or (Path(error.file).name if error.file else None)
            wrong = f"{error.problem} (the imported logs cannot be read as a campaign)"
            raise InputError(wrong, place=place) from error
    return campaign


def runs_yaml(logs: Sequence[Imported], proposed: Proposed) -> str:
    """The text of runs.yaml."""
    columns: dict[str, object] = {TIME: TIME}
    for p in proposed.proposals:
        title = titled(p.column, p.unit)
        columns[p.signal] = title if p.factor == 1.0 else {"column": title, "scale": float(p.factor)}
    runs = []
    for log in logs:
        said = {key: float(value) for key in SAID if (value := getattr(log, key)) is not None}
        runs.append({"name": log.name, "file": f"runs/{log.name}.parquet", **said})
    return dumps({"columns": columns, "runs": runs})
