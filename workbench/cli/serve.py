"""`workbench serve`: a machine's plant in real time, for a controller or PLC at the other end of a line."""

from __future__ import annotations

import json
import math
import signal
import threading
from pathlib import Path
from typing import Annotated, Literal

import click

from workbench.cli.options import command
from workbench.core.whole_folder import replace_json
from workbench.effects import check
from workbench.machines import load_machine
from workbench.serve.serve import Wish, chosen_ready, last_words
from workbench.serve.serve import serve as serve_plant


@command("serve", effects=True)
def serve(
    machine: Path,
    *,
    protocol: Literal["udp", "modbus", "opcua"] = "udp",
    rate_hz: Annotated[float, "--rate"] = 1000.0,
    address: str = "127.0.0.1",
    token: Annotated[str, {"envvar": "WORKBENCH_TOKEN", "show_envvar": True}] = "",
    port: Annotated[int | None, click.IntRange(0, 65535)] = None,
    payload_kg: Annotated[float, "--payload"] = 0.0,
    start_position_m: Annotated[float | None, "--start-position"] = None,
    watchdog_s: Annotated[float, "--watchdog"] = 0.1,
    leave_brake: bool = False,
    ready: str | None = None,
    send_every: Annotated[int, click.IntRange(1)] = 1,
    lock_step: bool = False,
    priority: bool = False,
    seconds: Annotated[float | None, "--for"] = None,
    status: Path | None = None,
) -> None:
    """Serve the plant of MACHINE, a machine.yaml: torque in, speed, height and tensions out, faults on command; an
    axis: force or torque in, position and speed out.

    docs/serve.md lists packets, registers and nodes. The plant is held at rest until the first torque arrives. Ctrl-C
    stops it; a histogram shows how late the steps began.

    protocol: opcua needs the extra 'serve'.
    rate_hz: Steps of the plant per second.
    address: Address to listen on. The default is reachable from this computer only; others need --token.
    token: 8 to 16 characters that clients have to show.
    port: Port. Default: 5560 (udp), 5020 (modbus), 4840 (opcua); 0: any free port.
    payload_kg: Payload at the start, in kg.
    start_position_m: Height at the start, in m (an axis: its position, m or rad). Default: mid rail; 0.
    watchdog_s: Time without a message, in s, after which the torque is set to zero.
    leave_brake: Keep the brake open when the watchdog acts.
    ready: Effects that clients may set while the plant runs, separated by commas, or 'all'.
    send_every: Send a state every N steps.
    lock_step: Step once per command instead of in real time (udp); for tests.
    priority: Ask the operating system for a higher priority.
    seconds: Run time in s. Default: until Ctrl-C.
    status: Write the last status to a JSON file.
    """
    read = load_machine(machine, check_effects=check)
    wished = Wish(
        protocol=protocol, rate_hz=rate_hz, address=address, token=token, port=port, payload_kg=payload_kg,
        start_position_m=start_position_m, watchdog_s=watchdog_s, send_every=send_every, lock_step=lock_step,
        priority=priority, watchdog_brake=not leave_brake, ready=tuple(chosen_ready(ready, read)),
    )  # fmt: skip
    stop = threading.Event()
    for name in (signal.SIGINT, signal.SIGTERM):
        signal.signal(name, lambda *_: stop.set())
    for_s = math.inf if seconds is None else seconds
    last = serve_plant(read, wished, lambda line: click.echo(line, err=True), stop, for_s=for_s)
    if status is not None:
        replace_json(status, json.loads(json.dumps(last)), "pace")
    click.echo("\n".join(last_words(last, lock_step=wished.lock_step)))
