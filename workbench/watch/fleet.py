"""Many machines at once: each with its own logs and state, in this process or spread over a cluster's workers.

A machine that cannot be watched (a damaged state, a server that does not answer) is a row of the table with its reason;
it is tried again at each look, and keeps nobody else from being watched. A worker keeps the machines that it has been
given; when it is lost, others take them up from their states, which all workers reach.
"""

from __future__ import annotations

import contextlib
import os
import sqlite3
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from workbench.core.errors import InputError, one_line
from workbench.core.names import unit_of
from workbench.core.record import Finite, Record
from workbench.effects import check
from workbench.logs.runs_file import Name
from workbench.machines import load_machine
from workbench.study.cluster import client_on
from workbench.watch.judge import Rules
from workbench.watch.opcua import SCHEME, Line, line_of
from workbench.watch.store import UnwritableError
from workbench.watch.watch import Diagnoser, Say, Watch

STATES = ("failed", "alarm", "learning", "healthy")  # in the order of the table
WORKER_S = 600.0  # for a worker's answer on one machine, a diagnosis included


class FleetMachine(Record):
    """logs: a folder or an OPC UA server; machine: its machine.yaml. Paths start where fleet.yaml stands."""

    logs: Annotated[str, Field(min_length=1)]
    machine: Annotated[str, Field(min_length=1)]
    nodes: Annotated[str, Field(min_length=1)] | None = None
    still: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] | None = None
    limits: dict[str, Finite] = Field(default_factory=dict)


class FleetFile(Record):
    """fleet.yaml."""

    format: Literal[1] = 1
    machines: Annotated[dict[Name, FleetMachine], Field(min_length=1)]


@dataclass(frozen=True)
class Plan:
    """How one machine is watched; what it holds goes to other processes. sample_s, stand_s, silent_s: of a stream;
    page: writes the page of a watch to a file; wait_s: for another watch of the same state."""

    name: str
    source: str
    machine: Path
    state: Path
    rules: Rules
    nodes: Path | None = None
    still: float | None = None
    sample_s: float = 0.01
    stand_s: float = 2.0
    silent_s: float = 2.0
    settle_s: float = 2.0
    once: bool = False
    diagnose: Diagnoser | None = None
    hook: str | None = None
    page: Callable[[Watch, Path], None] | None = None
    wait_s: float = 0.0


def opened(plan: Plan, say: Say) -> tuple[Watch, Line | None]:
    """The watch at work, with the line that feeds it. InputError for what cannot be watched."""
    machine = load_machine(plan.machine, check_effects=check)
    streams = plan.source.startswith(SCHEME)
    folder, line = Path(plan.source), None
    if streams:
        folder = plan.state / "stream"
        line = line_of(plan.source, plan.nodes, machine, folder, plan.sample_s, plan.still, plan.stand_s, plan.silent_s,
                       once=plan.once)  # fmt: skip
    page = plan.page
    watch = Watch(
        folder, machine, plan.state, plan.rules, settle_s=0.0 if streams else plan.settle_s, line=line,
        diagnose=plan.diagnose, hook=plan.hook, say=say, wait_s=plan.wait_s,
        page=lambda made: page(made, plan.state / "watch.html") if page is not None else None,
    )  # fmt: skip
    if line is not None:
        try:
            line.start()
        except BaseException:
            watch.close()
            raise
        say(f"Listening to {plan.source}; Ctrl-C ends it.")
    return watch, line


@dataclass(frozen=True)
class Row:
    """A machine of the fleet. last_start_s: of its last cycle; since: the first cycle of its last change; amount: of
    the likeliest cause, in its unit; trouble: why it is not watched, or cannot be written. new, waiting: by this
    look."""

    machine: str
    state: str
    cycles: int = 0
    last_cycle: str = ""
    last_start_s: float | None = None
    alarms: int = 0
    since: str = ""
    cause: str = ""
    amount: float | None = None
    unit: str = ""
    cycles_left: float | None = None
    diagnosis: str = ""
    trouble: str = ""
    new: int = field(default=0, metadata={"hidden": True})
    waiting: int = field(default=0, metadata={"hidden": True})


COLUMNS = tuple(f.name for f in fields(Row) if not f.metadata)
_open: dict[Path, tuple[Watch, Line | None, list[str]]] = {}


def read_fleet(file: Path, state: Path, rules: Rules, **more: Any) -> list[Plan]:
    """A plan for each machine of fleet.yaml, its state in a folder of its name; more: of every `Plan`."""
    from workbench.core.yaml_strict import load, validate

    def placed(text: str) -> str:
        return text if text.startswith(SCHEME) else str(file.parent / text)

    plans = []
    for name, one in validate(FleetFile, load(file)).machines.items():
        its = Rules(**{**vars(rules), "limits": {**rules.limits, **one.limits}})
        nodes = None if one.nodes is None else file.parent / one.nodes
        plans.append(
            Plan(name, placed(one.logs), file.parent / one.machine, state / name, its, nodes, one.still, **more)
        )
    return plans


def look(plan: Plan) -> tuple[Row, list[str]]:
    """One look at a machine, in the process that has it, and what there is to be said."""
    said: list[str] = []
    try:
        if plan.state not in _open:
            lines: list[str] = []
            _open[plan.state] = (*opened(plan, lines.append), lines)
        watch, _, lines = _open[plan.state]
        new, waiting = watch.look(time.monotonic())
        said, lines[:] = list(lines), []
        return row_of(plan.name, watch, new, waiting), said
    except (InputError, OSError, MemoryError) as error:
        close(plan)
        return Row(plan.name, "failed", trouble=one_line(str(error))), said


def close(plan: Plan, *, report: bool = False) -> int:
    """Lets a machine go; how many alarms no exit status had told of, if it is to tell of them."""
    watch, line, _ = _open.pop(plan.state, (None, None, None))
    if line is not None:
        line.close()
    if watch is None:
        return 0
    try:
        return watch.store.report() if report else 0
    finally:
        watch.close()


def row_of(name: str, watch: Watch, new: int = 0, waiting: int = 0) -> Row:
    """What a watch knows of its machine."""
    alarms = [alarm for alarm in watch.store.alarms() if not alarm.again]
    cycles, trouble = watch.judge.cycles, "" if watch.trouble is None else str(watch.trouble)
    known = watch.judge.baseline is not None
    state = (
        "failed" if trouble else "alarm" if watch.judge.state.base is not None else "healthy" if known else "learning"
    )
    row = Row(name, state, len(cycles), alarms=len(alarms), trouble=trouble, new=new, waiting=waiting)
    if cycles:
        row = replace(row, last_cycle=cycles[-1].name, last_start_s=cycles[-1].start_s)
    if not alarms:
        return row
    told = watch.told(alarms[-1])
    cause = told.causes[0]
    return replace(
        row, since=cycles[told.onset].name, cause=cause["name"], amount=cause["amount"], unit=unit_of(cause["keys"][0]),
        cycles_left=told.cycles_left, diagnosis="" if told.diagnosis is None else told.diagnosis["sentence"],
    )  # fmt: skip


Looker = Callable[[Sequence[Plan]], list[tuple[Row, list[str]]]]


@contextmanager
def lookers(cluster: str | None) -> Iterator[tuple[Looker, Callable[[Plan, bool], int]]]:
    """What looks at all machines once, and what lets one go: here, or on the workers of a cluster (`local:N`, or a
    scheduler's address)."""
    if cluster is None:
        yield lambda plans: [look(plan) for plan in plans], lambda plan, report: close(plan, report=report)
        return
    with client_on(cluster) as client:
        homes: dict[str, str] = {}
        yield (
            lambda plans: _looked_on(client, plans, homes),
            lambda plan, report: _closed_on(client, plan, report, homes),
        )


def _looked_on(client: Any, plans: Sequence[Plan], homes: dict[str, str]) -> list[tuple[Row, list[str]]]:
    """Each machine at its worker; those of a lost one, and new ones, at the worker with the fewest."""
    workers = sorted(client.scheduler_info(n_workers=-1)["workers"])
    if not workers:
        return [(Row(plan.name, "failed", trouble="the cluster has no worker"), []) for plan in plans]
    futures = []
    for plan in plans:
        if homes.get(plan.name) not in workers:
            homes[plan.name] = min(workers, key=lambda worker: sum(home == worker for home in homes.values()))
        futures.append(client.submit(look, plan, workers=[homes[plan.name]], pure=False, retries=0))
    return [_answer(plan, future) for plan, future in zip(plans, futures, strict=True)]


def _answer(plan: Plan, future: Any) -> tuple[Row, list[str]]:
    try:
        row, said = future.result(timeout=WORKER_S)
        return row, said
    except Exception as error:  # whatever a cluster ends a task with: lost worker, cancelled, no answer
        reason = f"its worker gave no answer ({type(error).__name__}); it is tried again"
        return Row(plan.name, "failed", trouble=reason), []


def _closed_on(client: Any, plan: Plan, report: bool, homes: Mapping[str, str]) -> int:
    if plan.name not in homes:
        return 0
    future = client.submit(close, plan, report=report, workers=[homes[plan.name]], pure=False, retries=0)
    with contextlib.suppress(Exception):  # a lost worker holds nothing any more
        return int(future.result(timeout=WORKER_S))
    return 0


def run_fleet(
    plans: Sequence[Plan], cluster: str | None, folder: Path, every_s: float, stop: Callable[[], bool], *, once: bool,
    settle_s: float, say: Say,
) -> tuple[list[Row], int]:  # fmt: skip
    """Looks at all machines again and again until `stop`; once: until none waits any more. The last rows, and how many
    alarms no exit status had told of: none are told of where a machine failed."""
    rows: list[Row] = []
    quiet_until, troubles = None, dict[str, str]()
    with lookers(cluster) as (look_at, let_go):
        while not stop():
            now = time.monotonic()
            looked = look_at(plans)
            rows = [row for row, _ in looked]
            for row, said in looked:
                if row.trouble and troubles.get(row.machine) != row.trouble:
                    said = [*said, row.trouble]
                troubles[row.machine] = row.trouble
                for line in said:
                    say(f"{row.machine}: {line}")
            write_table(folder, rows)
            if once:
                if not any(row.waiting for row in rows):
                    break
                if any(row.new for row in rows) or quiet_until is None:
                    quiet_until = now + 2.0 * settle_s + every_s
                if now >= quiet_until:
                    break
            time.sleep(min(every_s, max(0.05, settle_s)) if once else every_s)
        failed = any(row.state == "failed" for row in rows)
        return rows, sum(let_go(plan, not failed) for plan in plans)


def write_table(folder: Path, rows: Sequence[Row]) -> None:
    """fleet.parquet and the table `machines` of fleet.sqlite, as they are now, the worst machines first."""
    import pyarrow as pa
    import pyarrow.parquet

    ordered = sorted(rows, key=lambda row: (STATES.index(row.state), row.machine))
    data = [{name: value for name, value in asdict(row).items() if name in COLUMNS} for row in ordered]
    kinds = {int: pa.int64(), float: pa.float64(), str: pa.string()}
    numbers = {"cycles": int, "alarms": int, "last_start_s": float, "amount": float, "cycles_left": float}
    schema = pa.schema([(name, kinds[numbers.get(name, str)]) for name in COLUMNS])
    hidden = folder / ".fleet.parquet.part"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        pyarrow.parquet.write_table(pa.Table.from_pylist(data, schema=schema), hidden)
        os.replace(hidden, folder / "fleet.parquet")
        with contextlib.closing(sqlite3.connect(folder / "fleet.sqlite")) as db, db:
            db.execute(f"CREATE TABLE IF NOT EXISTS machines ({', '.join(COLUMNS)})")
            db.execute("DELETE FROM machines")
            marks = ", ".join("?" * len(COLUMNS))
            db.executemany(f"INSERT INTO machines VALUES ({marks})", [tuple(one.values()) for one in data])
    except (OSError, sqlite3.Error) as error:
        raise UnwritableError(f"cannot be written: {error}", file=folder / "fleet.parquet") from error
