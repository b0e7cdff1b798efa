"""`workbench app`: the dashboard in a browser."""

from __future__ import annotations

import importlib.util
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Annotated

import click

from workbench.cli.options import command
from workbench.core.errors import InputError

FIRST_PORT = 8501
STARTS_WITHIN_S = 60.0
ENDS_WITHIN_S = 5.0
EXIT_TERMINATED = 143


@command("app")
def app(
    *,
    port: Annotated[
        int | None, click.IntRange(1, 65535), f"Port to listen on. Default: the first free one from {FIRST_PORT}."
    ] = None,
    address: str = "127.0.0.1",
    hosts: Annotated[tuple[str, ...], "--host"] = (),
    no_browser: bool = False,
) -> int:
    """Open the dashboard in a browser: studies, comparison, loops, validation, diagnosis, batches.

    Ctrl-C ends it. The dashboard has no login: everybody who can reach the address can use it.

    address: Address to listen on. The default is reachable from this computer only.
    hosts: Host name that a proxy forwards; may be repeated. Other names are rejected.
    no_browser: Open no browser window.
    """
    if importlib.util.find_spec("streamlit") is None:
        raise InputError("the dashboard needs the extra 'app'; from a checkout: pip install '.[app]'")
    if port is not None and not _is_free(address, port):
        raise InputError(f"port {port} of {address} is taken or not ours to use; choose another", place="--port")
    chosen = port or next((p for p in range(FIRST_PORT, FIRST_PORT + 100) if _is_free(address, p)), None)
    if chosen is None:
        raise InputError(f"no free port from {FIRST_PORT} on; choose one", place="--port")
    shown = f"[{address}]" if ":" in address else address
    reached = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(address, shown)  # by this computer
    with _server(chosen, address, hosts) as server:
        _wait_for(f"http://{reached}:{chosen}/_stcore/health", server)
        try:
            click.echo(f"The dashboard runs at http://{shown}:{chosen}; Ctrl-C ends it.")
            if not no_browser:
                _open(f"http://{shown}:{chosen}")
            return server.wait()
        except KeyboardInterrupt:  # how it is meant to end: nothing has failed, and make shall not say so
            click.echo("\nThe dashboard has ended.")
            return 0


def _open(url: str) -> None:
    """Opens a browser if there is one. xdg-open's messages about missing ones would push the address off the screen."""
    words = [sys.executable, "-c", "import sys, click; click.launch(sys.argv[1])", url]
    subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


@contextmanager
def _server(port: int, address: str, hosts: tuple[str, ...]) -> Iterator[subprocess.Popen[bytes]]:
    """The server as a child process; it is terminated at the end of the block, and killed if it does not end."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(EXIT_TERMINATED))  # so that the block ends then too
    words = [sys.executable, "-m", "workbench.dashboard.server", str(port), address, *hosts]
    # The address that streamlit would tell of is the one that it listens on, not the one to open.
    # Small matrices of many sessions: threads of the linear algebra wait for each other (15 ms for one of four rows).
    environment = {"STREAMLIT_LOGGER_LEVEL": "warning", "OPENBLAS_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "2"}
    environment |= os.environ
    server = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, env=environment)
    try:
        yield server
    finally:
        server.terminate()
        try:
            server.wait(ENDS_WITHIN_S)
        except subprocess.TimeoutExpired:
            server.kill()
            server.wait()


def _wait_for(health: str, server: subprocess.Popen[bytes]) -> None:
    until = time.monotonic() + STARTS_WITHIN_S
    while time.monotonic() < until:
        if (ended := server.poll()) is not None:
            raise InputError(f"the dashboard's server ended with status {ended}; its own words stand above")
        try:
            with urllib.request.urlopen(health, timeout=1.0):
                return
        except OSError:
            time.sleep(0.1)
    raise InputError(f"the dashboard's server did not answer within {STARTS_WITHIN_S:.0f} s")


def _is_free(address: str, port: int) -> bool:
    try:
        family = socket.getaddrinfo(address, port, type=socket.SOCK_STREAM)[0][0]
    except OSError as error:
        raise InputError(f"'{address}' is no address of this computer: {error.strerror}", place="--address") from error
    with closing(socket.socket(family, socket.SOCK_STREAM)) as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind((address, port))
        except OSError:
            return False
    return True
