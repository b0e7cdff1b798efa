"""`python -m benchmarks.run`: measure against the peers, print the table, write results.json."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from .rows import ACCURACY, FIT_ACCURACY, RESULTS, Row
from .suites import all_rows

BATCH_PER_SECOND = 500.0
BUSY = 1.1  # clock time over CPU time


def table(rows: Sequence[Row]) -> Table:
    shown = Table(title="49.76 s of motion; medians of CPU time, interleaved warm runs, one thread")
    for heading in ("name", "workbench", "peer", "peer's time", "ratio", "target", "error", "peer's error"):
        shown.add_column(heading, justify="left" if heading in ("name", "peer") else "right")
    for row in rows:
        target = "" if row.target is None else f"{row.target:.0f} {'met' if row.ratio >= row.target else 'missed'}"
        shown.add_row(
            row.name,
            _seconds(row.ours.seconds),
            row.peer,
            _seconds(row.theirs.seconds),
            _ratio(row.ratio),
            target,
            _error(row.name, row.ours.error),
            _error(row.name, row.theirs.error),
        )
    return shown


def _seconds(s: float) -> str:
    return f"{s:.2f} s" if s >= 1.0 else f"{s * 1e3:.3g} ms"


def _ratio(ratio: float) -> str:
    return f"{ratio:.0f}" if ratio >= 10.0 else f"{ratio:.1f}"


def _error(name: str, error: float) -> str:
    limit = FIT_ACCURACY if name == "fit" else ACCURACY
    return f"{error:.1e}" + ("" if error <= limit else " !")


def main() -> None:
    console = Console()
    if not console.is_terminal:
        console = Console(width=120)
    begin = time.perf_counter()
    rows = all_rows()
    RESULTS.write_text(json.dumps([row.record() for row in rows], indent=1) + "\n", encoding="utf-8")
    console.print(table(rows))
    for row in rows:
        console.print(f"  {row.name:12s} {row.peer:15s} {row.setting}", highlight=False)
    batch = next(row for row in rows if row.name == "batch")
    rate = 1.0 / batch.ours.seconds
    verdict = "met" if rate >= BATCH_PER_SECOND else "missed"
    console.print(f"batch: {rate:.0f} runs a second and core, target {BATCH_PER_SECOND:.0f}, {verdict}")
    console.print(
        f"errors: motor speed against Runge-Kutta at 5 microseconds over its largest value, at most {ACCURACY:g}; "
        f"fit: worst parameter, at most {FIT_ACCURACY:g}; ! marks what is above"
    )
    waited = max(m.clock_seconds / m.seconds for row in rows for m in (row.ours, row.theirs))
    if waited > BUSY:
        console.print(
            f"the machine was busy: by the clock something took {waited:.2f} times its CPU time. "
            "Ratios are those of CPU time; even they are surer on a quiet machine"
        )
    console.print(f"{time.perf_counter() - begin:.0f} s; wrote {RESULTS}")


if __name__ == "__main__":
    main()
