"""`workbench serve`: a machine's plant in real time, for a controller or PLC at the other end of a line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from workbench.cli.options import effects_option


@click.command(name="serve")
@click.argument("machine", type=click.Path(path_type=Path))
@click.option("--protocol", type=click.Choice(["udp", "modbus", "opcua"]), default="udp", show_default=True,
              help="opcua needs the extra 'serve'.")  # fmt: skip
@click.option("--rate", "rate_hz", type=float, default=1000.0, show_default=True, help="Steps of the plant per second.")
@click.option("--address", default="127.0.0.1", show_default=True,
              help="Address to listen on. The default is reachable from this computer only; others need "
              "--token.")  # fmt: skip
@click.option("--token", default="", envvar="WORKBENCH_TOKEN", show_envvar=True,
              help="8 to 16 characters that clients have to show.")  # fmt: skip
@click.option("--port", type=click.IntRange(0, 65535),
              help="Port. Default: 5560 (udp), 5020 (modbus), 4840 (opcua); 0: any free port.")  # fmt: skip
@click.option(
    "--payload", "payload_kg", type=float, default=0.0, show_default=True, help="Payload at the start, in kg."
)
@click.option("--start-position", "start_position_m", type=float,
              help="Height at the start, in m (an axis: its position, m or rad). Default: mid rail; 0.")  # fmt: skip
@click.option("--watchdog", "watchdog_s", type=float, default=0.1, show_default=True,
              help="Time without a message, in s, after which the torque is set to zero.")  # fmt: skip
@click.option("--leave-brake", is_flag=True, help="Keep the brake open when the watchdog acts.")
@click.option("--ready", help="Effects that clients may set while the plant runs, separated by commas, or 'all'.")
@click.option("--send-every", type=click.IntRange(1), default=1, show_default=True, help="Send a state every N steps.")
@click.option("--lock-step", is_flag=True, help="Step once per command instead of in real time (udp); for tests.")
@click.option("--priority", is_flag=True, help="Ask the operating system for a higher priority.")
@click.option("--for", "seconds", type=float, help="Run time in s. Default: until Ctrl-C.")
@click.option("--status", type=click.Path(path_type=Path), help="Write the last status to a JSON file.")
@effects_option
def command(
    machine: Path, leave_brake: bool, ready: str | None, seconds: float | None, status: Path | None, **wish: Any
) -> None:
    """Serve the plant of MACHINE, a machine.yaml: torque in, speed, height and tensions out, faults on command; an
    axis: force or torque in, position and speed out.

    docs/serve.md lists packets, registers and nodes. The plant is held at rest until the first torque arrives. Ctrl-C
    stops it; a histogram shows how late the steps began.
    """
    import math
    import signal
    import threading

    from workbench.core.whole_folder import replace_json
    from workbench.effects import check
    from workbench.machines import load_machine
    from workbench.serve.serve import Wish, chosen_ready, last_words, serve

    read = load_machine(machine, check_effects=check)
    wished = Wish(**wish, watchdog_brake=not leave_brake, ready=tuple(chosen_ready(ready, read)))
    stop = threading.Event()
    for name in (signal.SIGINT, signal.SIGTERM):
        signal.signal(name, lambda *_: stop.set())
    for_s = math.inf if seconds is None else seconds
    last = serve(read, wished, lambda line: click.echo(line, err=True), stop, for_s=for_s)
    if status is not None:
        replace_json(status, json.loads(json.dumps(last)), "pace")
    click.echo("\n".join(last_words(last, lock_step=wished.lock_step)))
