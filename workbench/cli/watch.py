"""`workbench watch`: a machine watched by the logs that come in."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import click

from workbench.cli.options import command, keyed_number
from workbench.cli.show import print_table
from workbench.core.errors import InputError
from workbench.effects import check
from workbench.machines import load_machine
from workbench.view.watch import answer, fleet_table, write_page
from workbench.watch.cause import diagnosed
from workbench.watch.estimate import HEALTHY
from workbench.watch.fleet import Plan, opened, read_fleet, run_fleet
from workbench.watch.judge import Rules
from workbench.watch.store import DamagedError
from workbench.watch.store import rebuild as anew
from workbench.watch.watch import patient

EXIT_ALARM, EXIT_FAILED = 1, 2
WAIT_S = 60.0  # for another watch of the same state
AtLeast = click.FloatRange(0.2)


@command("watch", effects=True)
def watch(
    source: Annotated[str | None, {"metavar": "FOLDER|opc.tcp://…"}] = None,
    *,
    machine: Path | None = None,
    state: Path,
    once: bool = False,
    every: Annotated[float, click.FloatRange(0.05)] = 2.0,
    settle_s: Annotated[float, "--settle", click.FloatRange(0.0)] = 2.0,
    cycles_between: Annotated[float, "--false-alarms", click.FloatRange(10.0, 100000.0)] = 1000.0,
    healthy: Annotated[int | None, click.IntRange(20)] = None,
    pause: float = 3600.0,
    warm_up: float = 0.0,
    limits: Annotated[tuple[str, ...], "--limit", {"metavar": "KEY=VALUE"}] = (),
    nodes: Path | None = None,
    still: Annotated[float | None, click.FloatRange(0.0)] = None,
    stand_s: Annotated[float, "--stand", AtLeast] = 2.0,
    silent_s: Annotated[float, "--silent", AtLeast] = 2.0,
    sample_s: Annotated[float, "--sample", click.FloatRange(0.0005, 0.5)] = 0.01,
    seconds: Annotated[float | None, "--for", click.FloatRange(0.0)] = None,
    skip_diagnosis: bool = False,
    hook: Annotated[str | None, "--webhook"] = None,
    fleet: Path | None = None,
    cluster: Annotated[str | None, {"metavar": "ADDRESS"}] = None,
    rebuild: bool = False,
) -> int:
    """Estimate friction, mass, inertia and offset from each log in FOLDER, or each cycle of a stream; raise an alarm
    when they change.

    A log is described by its entry in FOLDER/runs.yaml, or by a file beside it, LOG.yaml, with payload_kg and
    start_position_m. A stream is an OPC UA server, opc.tcp://HOST:PORT; see docs/watch.md. The state consists of
    watch.sqlite, cycles.parquet, alarms.parquet and watch.html. Exit status: 1 if there is an alarm that no earlier
    call has reported so, 2 if anything failed, else 0. A fleet has the state of each machine in a folder
    of its name, and one table of all in fleet.parquet and fleet.sqlite.

    machine: The identified machine.yaml.
    state: Folder for the state between calls.
    once: Process the logs that are there, then stop. Default: wait for logs until Ctrl-C.
    every: Time between two looks into FOLDER, in s.
    settle_s: Time without a change, in s, after which a log is complete.
    cycles_between: Mean number of cycles between two false alarms.
    healthy: Number of cycles in the first baseline. Default: 100.
    pause: Rest, in s, after which the machine counts as cold.
    warm_up: Time after such a rest, in s, in which cycles are not judged.
    limits: Limit of a value. Default: 1.5 times the friction levels; may be repeated.
    nodes: For a stream: file that maps nodes to signals. Default: as `workbench serve`.
    still: For a stream: largest speed of a machine at rest, in the signal's unit. Default: 0.5 % of a hoist's
        nominal speed; required for an axis.
    stand_s: For a stream: rest, in s, that ends a cycle.
    silent_s: For a stream: time without a value, in s, after which the machine counts as stopped.
    sample_s: For a stream: sample time of the server, in s.
    seconds: Run time in s. Default: until Ctrl-C.
    skip_diagnosis: Do not diagnose new alarms.
    hook: Address to which each new alarm is posted as JSON.
    fleet: Watch all machines of this fleet.yaml in place of FOLDER and --machine.
    cluster: For a fleet: watch on Dask: tcp://host:port, or local:N for N local processes.
    rebuild: Make a damaged watch.sqlite anew from cycles.parquet, then go on.
    """
    rules = Rules(cycles_between, healthy or HEALTHY, pause, warm_up, dict(keyed_number(w, "limits") for w in limits))
    how = {"settle_s": settle_s, "hook": hook, "diagnose": None if skip_diagnosis else diagnosed, "page": write_page}
    more: dict[str, Any] = {"sample_s": sample_s, "stand_s": stand_s, "silent_s": silent_s, "once": once}
    stop = threading.Event()
    for name in (signal.SIGINT, signal.SIGTERM):
        signal.signal(name, lambda *_: stop.set())
    ends = math.inf if seconds is None else time.monotonic() + seconds

    def over() -> bool:
        return stop.is_set() or time.monotonic() >= ends

    try:
        if fleet is None:
            if source is None or machine is None or cluster is not None:
                raise InputError("FOLDER and --machine, or --fleet, with which --cluster goes", place="watch needs")
            plan = Plan("", source, machine, state, rules, nodes, still, **more, how={**how, "wait_s": WAIT_S})
            return _watch_one(plan, every, settle_s, over, rebuild=rebuild)
        if source is not None or machine is not None or rebuild:
            raise InputError("takes the place of FOLDER and --machine; rebuild machines one by one", place="fleet")
        plans = read_fleet(fleet, state, rules, **more, how=how)
        rows, alarms = run_fleet(plans, cluster, state, every, over, say=_say, once=once, settle_s=settle_s)
        print_table(fleet_table(rows))
        click.echo(f"\nTable: {state / 'fleet.parquet'} and {state / 'fleet.sqlite'}")
        sys.stdout.flush()
        return EXIT_FAILED if any(row.state == "failed" for row in rows) else EXIT_ALARM if alarms else 0
    except DamagedError as error:
        problem = error.problem.replace("'rebuild'", "the same command with --rebuild")
        raise InputError(problem, file=error.file) from error
    except BrokenPipeError:  # who reads the answer has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_FAILED
    except (InputError, OSError, MemoryError):
        raise
    except Exception:  # a defect shows where it arose, and is no alarm
        traceback.print_exc()
        return EXIT_FAILED


def _watch_one(plan: Plan, every_s: float, settle_s: float, over: Callable[[], bool], *, rebuild: bool) -> int:
    if rebuild:
        count = anew(plan.state, load_machine(plan.machine, check_effects=check), plan.rules)
        click.echo(f"watch.sqlite is made anew with {count} cycles; the damaged one is watch.sqlite.damaged.", err=True)
    with contextlib.closing(opened(plan, _say)) as watched:

        def look() -> tuple[int, int]:
            new, waiting = watched.look(time.monotonic())
            return new, -1 if watched.trouble is not None else waiting

        patient(look, every_s, over, once=plan.once, settle_s=settle_s)
        if watched.trouble is not None:
            raise watched.trouble
        click.echo(answer(watched))
        click.echo(f"\nReport: {plan.state / 'watch.html'}")
        sys.stdout.flush()  # before the alarms count as told
        return EXIT_ALARM if watched.store.report() else 0


def _say(text: str) -> None:
    """A full disk may hold what stderr is sent to; the watch goes on."""
    with contextlib.suppress(OSError):
        click.echo(text, err=True)
