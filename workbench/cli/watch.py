"""`workbench watch`: a machine watched by the logs that come in."""

from __future__ import annotations

from pathlib import Path

import click

from workbench.cli.options import effects_option

EXIT_ALARM = 1


@click.command(name="watch")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--machine", required=True, type=click.Path(path_type=Path), help="The machine as identified.")
@click.option("--state", required=True, type=click.Path(path_type=Path), help="Folder that keeps what is known.")
@click.option("--once", is_flag=True, help="Take what is there and end; else logs are waited for until Ctrl-C.")
@click.option(
    "--every", type=click.FloatRange(0.05), default=2.0, show_default=True, help="Looks every so many seconds."
)
@click.option("--settle", type=click.FloatRange(0.0), default=2.0, show_default=True,
              help="A log that has not changed for so long, in s, is complete.")  # fmt: skip
@click.option("--false-alarms", "cycles_between", type=click.FloatRange(10.0, 100_000.0), default=1000.0,
              show_default=True, help="Cycles between two false alarms, on average.")  # fmt: skip
@click.option("--healthy", type=click.IntRange(20), help="Cycles of the first baseline. Default: 100.")
@click.option("--pause", type=float, default=3600.0, show_default=True, help="A rest so long, in s, lets it cool.")
@click.option("--warm-up", type=float, default=0.0, show_default=True,
              help="So long after such a rest, in s, cycles do not count.")  # fmt: skip
@click.option("--limit", "limits", multiple=True, metavar="KEY=VALUE",
              help="What a value must not reach. Default: 1.5 times the friction levels. May be repeated.")  # fmt: skip
@click.option("--skip-diagnosis", is_flag=True, help="Do not diagnose new alarms.")
@click.option("--webhook", help="Address that each new alarm is posted to as JSON.")
@effects_option
def command(
    folder: Path,
    machine: Path,
    state: Path,
    once: bool,
    every: float,
    settle: float,
    cycles_between: float,
    healthy: int | None,
    pause: float,
    warm_up: float,
    limits: tuple[str, ...],
    skip_diagnosis: bool,
    webhook: str | None,
) -> int:
    """Watch the logs that come into FOLDER: each cycle's friction, mass, inertia and offset, and when they change.

    A log is described by its entry in FOLDER/runs.yaml, or by a file beside it, LOG.yaml, with payload_kg and
    start_position_m. The state holds watch.sqlite, cycles.parquet, alarms.parquet and watch.html. Exit status: 1
    where this call raised an alarm, 0 where it raised none.
    """
    import signal
    import threading

    from workbench.effects import check
    from workbench.machine import load_machine
    from workbench.reports.watch.page import answer, write_page
    from workbench.watch.change import HEALTHY
    from workbench.watch.diagnosed import diagnosed
    from workbench.watch.judge import Rules
    from workbench.watch.limits import read_limits
    from workbench.watch.watch import Watch, run

    rules = Rules(cycles_between, healthy or HEALTHY, pause, warm_up, read_limits(limits))
    read = load_machine(machine, check_effects=check)
    stop = threading.Event()
    for name in (signal.SIGINT, signal.SIGTERM):
        signal.signal(name, lambda *_: stop.set())
    watch = Watch(
        folder, read, state, rules, settle_s=settle, diagnose=None if skip_diagnosis else diagnosed, hook=webhook,
        say=lambda line: click.echo(line, err=True),
    )  # fmt: skip
    try:
        run(
            watch, every, stop.is_set, once=once, settle_s=settle, after=lambda: write_page(watch, state / "watch.html")
        )
        click.echo(answer(watch))
        click.echo(f"\nReport: {state / 'watch.html'}")
        return EXIT_ALARM if watch.new_alarms else 0
    finally:
        watch.close()
