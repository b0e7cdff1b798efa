"""`workbench watch`: a machine watched by the logs that come in."""

from __future__ import annotations

import contextlib
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from workbench.cli.options import effects_option, keyed_number
from workbench.core.errors import InputError

if TYPE_CHECKING:
    from workbench.watch.fleet import Plan

EXIT_ALARM, EXIT_FAILED = 1, 2
WAIT_S = 60.0  # for another watch of the same state


@click.command(name="watch")
@click.argument("source", metavar="FOLDER|opc.tcp://…", required=False)
@click.option("--machine", type=click.Path(path_type=Path), help="The identified machine.yaml.")
@click.option("--state", required=True, type=click.Path(path_type=Path), help="Folder for the state between calls.")
@click.option("--once", is_flag=True,
              help="Process the logs that are there, then stop. Default: wait for logs until Ctrl-C.")  # fmt: skip
@click.option("--every", type=click.FloatRange(0.05), default=2.0, show_default=True,
              help="Time between two looks into FOLDER, in s.")  # fmt: skip
@click.option("--settle", "settle_s", type=click.FloatRange(0.0), default=2.0, show_default=True,
              help="Time without a change, in s, after which a log is complete.")  # fmt: skip
@click.option("--false-alarms", "cycles_between", type=click.FloatRange(10.0, 100_000.0), default=1000.0,
              show_default=True, help="Mean number of cycles between two false alarms.")  # fmt: skip
@click.option("--healthy", type=click.IntRange(20), help="Number of cycles in the first baseline. Default: 100.")
@click.option("--pause", type=float, default=3600.0, show_default=True,
              help="Rest, in s, after which the machine counts as cold.")  # fmt: skip
@click.option("--warm-up", type=float, default=0.0, show_default=True,
              help="Time after such a rest, in s, in which cycles are not judged.")  # fmt: skip
@click.option("--limit", "limits", multiple=True, metavar="KEY=VALUE",
              help="Limit of a value. Default: 1.5 times the friction levels; may be repeated.")  # fmt: skip
@click.option("--nodes", type=click.Path(path_type=Path),
              help="For a stream: file that maps nodes to signals. Default: as `workbench serve`.")  # fmt: skip
@click.option("--still", type=click.FloatRange(0.0), help="For a stream: largest speed of a machine at rest, in the "
              "signal's unit. Default: 0.5 % of a hoist's nominal speed; required for an axis.")  # fmt: skip
@click.option("--stand", "stand_s", type=click.FloatRange(0.2), default=2.0, show_default=True,
              help="For a stream: rest, in s, that ends a cycle.")  # fmt: skip
@click.option("--silent", "silent_s", type=click.FloatRange(0.2), default=2.0, show_default=True,
              help="For a stream: time without a value, in s, after which the machine counts as stopped.")  # fmt: skip
@click.option("--sample", "sample_s", type=click.FloatRange(0.0005, 0.5), default=0.01, show_default=True,
              help="For a stream: sample time of the server, in s.")  # fmt: skip
@click.option("--for", "seconds", type=click.FloatRange(0.0), help="Run time in s. Default: until Ctrl-C.")
@click.option("--skip-diagnosis", is_flag=True, help="Do not diagnose new alarms.")
@click.option("--webhook", "hook", help="Address to which each new alarm is posted as JSON.")
@click.option("--fleet", type=click.Path(path_type=Path),
              help="Watch all machines of this fleet.yaml in place of FOLDER and --machine.")  # fmt: skip
@click.option("--cluster", metavar="ADDRESS",
              help="For a fleet: watch on Dask: tcp://host:port, or local:N for N local processes.")  # fmt: skip
@click.option("--rebuild", is_flag=True, help="Make a damaged watch.sqlite anew from cycles.parquet, then go on.")
@effects_option
def command(
    source: str | None, machine: Path | None, state: Path, every: float, cycles_between: float, healthy: int | None,
    pause: float, warm_up: float, limits: tuple[str, ...], nodes: Path | None, still: float | None,
    seconds: float | None, skip_diagnosis: bool, rebuild: bool, fleet: Path | None, cluster: str | None, **how: Any,
) -> int:  # fmt: skip
    """Estimate friction, mass, inertia and offset from each log in FOLDER, or each cycle of a stream; raise an alarm
    when they change.

    A log is described by its entry in FOLDER/runs.yaml, or by a file beside it, LOG.yaml, with payload_kg and
    start_position_m. A stream is an OPC UA server, opc.tcp://HOST:PORT; see docs/watch.md. The state consists of
    watch.sqlite, cycles.parquet, alarms.parquet and watch.html. Exit status: 1 if there is an alarm that no earlier
    call has reported so, 2 if anything failed, else 0. A fleet has the state of each machine in a folder
    of its name, and one table of all in fleet.parquet and fleet.sqlite.
    """
    import os
    import signal
    import threading
    import time
    import traceback

    from workbench.view.watch import fleet_table, write_page
    from workbench.watch.cause import diagnosed
    from workbench.watch.estimate import HEALTHY
    from workbench.watch.fleet import Plan, read_fleet, run_fleet
    from workbench.watch.judge import Rules
    from workbench.watch.store import DamagedError

    limited = dict(keyed_number(word, "limits") for word in limits)
    rules = Rules(cycles_between, healthy or HEALTHY, pause, warm_up, limited)
    how |= {"diagnose": None if skip_diagnosis else diagnosed, "page": write_page}
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
            plan = Plan("", source, machine, state, rules, nodes, still, wait_s=WAIT_S, **how)
            return _watch_one(plan, every, over, rebuild=rebuild)
        if source is not None or machine is not None or rebuild:
            raise InputError("takes the place of FOLDER and --machine; rebuild machines one by one", place="fleet")
        plans = read_fleet(fleet, state, rules, **how)
        waits = {"once": how["once"], "settle_s": how["settle_s"]}
        rows, alarms = run_fleet(plans, cluster, state, every, over, say=_say, **waits)
        from workbench.cli.show import print_table

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


def _watch_one(plan: Plan, every: float, over: Callable[[], bool], *, rebuild: bool) -> int:
    from workbench.effects import check
    from workbench.machines import load_machine
    from workbench.view.watch import answer
    from workbench.watch import watch as at_work
    from workbench.watch.fleet import opened

    if rebuild:
        count = at_work.rebuild(plan.state, load_machine(plan.machine, check_effects=check), plan.rules)
        click.echo(f"watch.sqlite is made anew with {count} cycles; the damaged one is watch.sqlite.damaged.", err=True)
    watch, line = opened(plan, _say)
    try:
        at_work.run(watch, every, over, once=plan.once, settle_s=plan.settle_s)
        click.echo(answer(watch))
        click.echo(f"\nReport: {plan.state / 'watch.html'}")
        sys.stdout.flush()  # before the alarms count as told
        return EXIT_ALARM if watch.store.report() else 0
    finally:
        if line is not None:
            line.close()
        watch.close()


def _say(text: str) -> None:
    """A full disk may hold what stderr is sent to; the watch goes on."""
    with contextlib.suppress(OSError):
        click.echo(text, err=True)
