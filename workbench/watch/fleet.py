"""Many machines at once: each with its own logs and state, in this process or spread over a cluster's workers.

A machine that cannot be watched (a damaged state, a server that does not answer) is a row of the table with its reason;
it is tried again at each look, and keeps nobody else from being watched. A worker keeps the machines that it has been
given; when it is lost, others take them up from their states, which all workers reach.
"""

from __future__ import annotations

import contextlib
import sqlite3
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, get_type_hints

from pydantic import Field

from workbench.core.errors import InputError, UnwritableError, one_line
from workbench.core.names import unit_of
from workbench.core.record import Finite, Record
from workbench.core.yaml_strict import load, validate
from workbench.effects import check
from workbench.logs.raw_run import Name
from workbench.machines import load_machine
from workbench.study.cluster import client_on
from workbench.watch.judge import Rules
from workbench.watch.opcua import SCHEME, TRIGGER, CutRules, Line, nodes_of, still_speed
from workbench.watch.store import replace_table
from workbench.watch.watch import Say, Watch, patient

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
    """How one machine is watched; what it holds goes to other processes. source: a folder or a server's address; nodes,
    still, sample_s, stand_s, silent_s: of a stream; how: what else a `Watch` takes."""

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
    once: bool = False
    how: Mapping[str, Any] = field(default_factory=dict)


def read_fleet(file: Path, state: Path, rules: Rules, **more: Any) -> list[Plan]:
    """A plan for each machine of fleet.yaml, its state in a folder of its name; more: of every `Plan`."""
    beside, plans = file.parent, []
    for name, one in validate(FleetFile, load(file)).machines.items():
        source = one.logs if one.logs.startswith(SCHEME) else str(beside / one.logs)
        its = replace(rules, limits={**rules.limits, **one.limits})
        nodes = None if one.nodes is None else beside / one.nodes
        plans.append(Plan(name, source, beside / one.machine, state / name, its, nodes, one.still, **more))
    return plans


def opened(plan: Plan, say: Say) -> Watch:
    """The watch at work, with the line that feeds it. InputError for what cannot be watched."""
    machine = load_machine(plan.machine, check_effects=check)
    if not plan.source.startswith(SCHEME):
        return Watch(Path(plan.source), machine, plan.state, plan.rules, say=say, **plan.how)
    if plan.once:
        raise InputError("a stream has no end; it is watched until it is stopped, or for a stated time", place="once")
    which, folder = nodes_of(plan.nodes, machine), plan.state / "stream"
    still, triggered = still_speed(machine, plan.still), TRIGGER in which.nodes
    rules = CutRules(which.motion, still, which.is_position, plan.stand_s, plan.silent_s, triggered=triggered)
    line = Line(plan.source, which, rules, machine, folder, plan.sample_s)
    watch = Watch(folder, machine, plan.state, plan.rules, line=line, say=say, **{**plan.how, "settle_s": 0.0})
    try:
        line.start()
    except BaseException:
        watch.close()
        raise
    say(f"Listening to {plan.source}; Ctrl-C ends it.")
    return watch


@dataclass(frozen=True)
class Row:
    """A machine of the fleet. last_start_s: of its last cycle; since: the first cycle of its last change; amount: of
    the likeliest cause, in its unit; trouble: why it is not watched, or cannot be written."""

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


class Looked(NamedTuple):
    """What came of a look: new cycles, logs that are waited for, what is to be said."""

    row: Row
    new: int = 0
    waiting: int = 0
    said: Sequence[str] = ()


_open: dict[Path, tuple[Watch, list[str]]] = {}  # by the folder of the state, in this process


def look(plan: Plan) -> Looked:
    """One look at a machine, in the process that has it."""
    try:
        if plan.state not in _open:
            lines: list[str] = []
            _open[plan.state] = opened(plan, lines.append), lines
        watch, lines = _open[plan.state]
        new, waiting = watch.look(time.monotonic())
        said, lines[:] = list(lines), []
        return Looked(row_of(plan.name, watch), new, waiting, said)
    except (InputError, OSError, MemoryError) as error:
        close(plan)
        return _failed(plan, one_line(str(error)))


def close(plan: Plan, report: bool = False) -> int:
    """Lets a machine go; how many alarms no exit status had told of, if it is to tell of them."""
    if plan.state not in _open:
        return 0
    with contextlib.closing(_open.pop(plan.state)[0]) as watch:
        return watch.store.report() if report else 0


def _failed(plan: Plan, trouble: str) -> Looked:
    return Looked(Row(plan.name, "failed", trouble=trouble))


def row_of(name: str, watch: Watch) -> Row:
    """What a watch knows of its machine."""
    judge, trouble = watch.judge, "" if watch.trouble is None else str(watch.trouble)
    known = "alarm" if judge.state.base is not None else "learning" if judge.baseline is None else "healthy"
    row = Row(name, "failed" if trouble else known, len(judge.cycles), alarms=len(watch.alarms), trouble=trouble)
    if judge.cycles:
        row = replace(row, last_cycle=judge.cycles[-1].name, last_start_s=judge.cycles[-1].start_s)
    if not watch.alarms:
        return row
    told = watch.told(watch.alarms[-1])
    (cause, *_), said = told.causes, "" if told.diagnosis is None else told.diagnosis["sentence"]
    return replace(
        row, since=judge.cycles[told.onset].name, cause=cause.name, amount=cause.amount, unit=unit_of(cause.keys[0]),
        cycles_left=told.cycles_left, diagnosis=said,
    )  # fmt: skip


class Workers:
    """The workers of a cluster, each with the machines that it has been given; without a cluster, this process."""

    def __init__(self, client: Any) -> None:
        self._client, self._homes = client, dict[str, str]()

    def look(self, plans: Sequence[Plan]) -> list[Looked]:
        """Each machine at its worker; those of a lost one, and new ones, at the worker with the fewest."""
        if self._client is None:
            return [look(plan) for plan in plans]
        workers = sorted(self._client.scheduler_info(n_workers=-1)["workers"])
        if not workers:
            return [_failed(plan, "the cluster has no worker") for plan in plans]
        for plan in plans:
            if self._homes.get(plan.name) not in workers:
                homes = list(self._homes.values())
                self._homes[plan.name] = min(workers, key=homes.count)
        looked = []
        for plan, future in [(plan, self._asked(look, plan)) for plan in plans]:
            try:
                looked.append(Looked(*future.result(timeout=WORKER_S)))
            except Exception as error:  # whatever a cluster ends a task with: lost worker, cancelled, no answer
                reason = f"its worker gave no answer ({type(error).__name__}); it is tried again"
                looked.append(_failed(plan, reason))
        return looked

    def close(self, plan: Plan, report: bool) -> int:
        if self._client is None:
            return close(plan, report)
        if plan.name in self._homes:
            with contextlib.suppress(Exception):  # a lost worker holds nothing any more
                return int(self._asked(close, plan, report).result(timeout=WORKER_S))
        return 0

    def _asked(self, what: Callable[..., Any], plan: Plan, *more: Any) -> Any:
        return self._client.submit(what, plan, *more, workers=[self._homes[plan.name]], pure=False, retries=0)


def run_fleet(
    plans: Sequence[Plan], cluster: str | None, folder: Path, every_s: float, stop: Callable[[], bool], *, once: bool,
    settle_s: float, say: Say,
) -> tuple[list[Row], int]:  # fmt: skip
    """Looks at all machines again and again, as `patient`. The last rows, and how many alarms no exit status had told
    of: none are told of where a machine failed."""
    rows, troubles = list[Row](), dict[str, str]()
    with nullcontext() if cluster is None else client_on(cluster) as client:
        workers = Workers(client)

        def look_at_all() -> tuple[int, int]:
            looked = workers.look(plans)
            rows[:] = [one.row for one in looked]
            for row, _, _, said in looked:
                again = not row.trouble or troubles.get(row.machine) == row.trouble
                troubles[row.machine] = row.trouble
                for line in [*said, *([] if again else [row.trouble])]:
                    say(f"{row.machine}: {line}")
            write_table(folder, rows)
            return sum(one.new for one in looked), sum(one.waiting for one in looked)

        patient(look_at_all, every_s, stop, once=once, settle_s=settle_s)
        failed = any(row.state == "failed" for row in rows)
        return rows, sum(workers.close(plan, not failed) for plan in plans)


def by_state(rows: Sequence[Row]) -> list[Row]:
    """The worst machines first."""
    return sorted(rows, key=lambda row: (STATES.index(row.state), row.machine))


def write_table(folder: Path, rows: Sequence[Row]) -> None:
    """fleet.parquet and the table `machines` of fleet.sqlite, as they are now, the worst machines first."""
    data, kinds = [asdict(row) for row in by_state(rows)], {int: "int64", str: "string"}
    columns = {name: kinds.get(hint, "float64") for name, hint in get_type_hints(Row).items()}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        replace_table(folder / "fleet.parquet", data, list(columns.items()))
        with contextlib.closing(sqlite3.connect(folder / "fleet.sqlite")) as db, db:
            db.execute(f"CREATE TABLE IF NOT EXISTS machines ({', '.join(columns)})")
            db.execute("DELETE FROM machines")
            places = ", ".join(f":{name}" for name in columns)
            db.executemany(f"INSERT INTO machines VALUES ({places})", data)
    except (OSError, sqlite3.Error) as error:
        raise UnwritableError(f"cannot be written: {error}", file=folder / "fleet.parquet") from error
