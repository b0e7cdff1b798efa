"""Which signals a machine's logs carry, and how a file's columns become them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from workbench.errors import InputError, nearest
from workbench.kinds import TIME, SignalSet
from workbench.log_formats.opening import LogFile, Table
from workbench.logs.runs_file import Column
from workbench.run import Array


@dataclass(frozen=True)
class Raw:
    """One run's signals as logged, in SI: not yet checked, time not yet known to rise."""

    table: Table
    columns: Mapping[str, str]  # signal -> column of the file
    values: dict[str, Array]
    ignored: tuple[str, ...]

    def label(self, signal: str) -> str:
        """The signal's name, with the column's where that is another one."""
        column = self.columns.get(signal, signal)
        return signal if column == signal else f"{signal} (column '{column}')"


def read_signals(log: LogFile, wanted: SignalSet, mapping: Mapping[str, Column], run: str) -> Raw:
    """The signals of one log. InputError when a needed one has no column, with the columns there are."""
    columns = {
        signal: mapping[signal].column if signal in mapping else signal
        for signal in wanted.names
        if signal in mapping or signal in log.names
    }
    for signal, column in columns.items():
        if column not in log.names:
            raise _missing(log, f"column '{column}' for {signal}", column, run)
    for group in wanted.needed:
        if not any(all(name in columns for name in alternative) for alternative in group):
            words = " or ".join(" and ".join(alternative) for alternative in group)
            first = next((name for alternative in group for name in alternative if name not in columns), TIME)
            raise _missing(log, f"column {words}", first, run)
    table = log.read(list(dict.fromkeys(columns.values())))
    values: dict[str, Array] = {}
    for signal, column in columns.items():
        rule = mapping.get(signal)
        plain = rule is None or (rule.scale == 1.0 and rule.offset == 0.0)
        values[signal] = (
            table.columns[column] if plain or rule is None else rule.scale * table.columns[column] + rule.offset
        )
    used = set(columns.values())
    return Raw(table, columns, values, tuple(name for name in log.names if name not in used))


def _missing(log: LogFile, what: str, name: str, run: str) -> InputError:
    if not log.names:
        return InputError(f"no {what}: the file holds no columns of numbers", file=log.file, place=run)
    hint = nearest(name, log.names)
    if hint.startswith("did you mean"):
        hint += f" The file has: {_listed(log.names)}"
    else:
        hint = f"the file has: {_listed(log.names)}"
    return InputError(f"no {what}; {hint}", file=log.file, place=run)


def _listed(names: tuple[str, ...], most: int = 30) -> str:
    shown = [repr(name)[1:-1] for name in names[:most]]
    return ", ".join(shown) + (f" and {len(names) - most} more" if len(names) > most else "")
