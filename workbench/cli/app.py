"""`workbench app`: the dashboard in a browser."""

from __future__ import annotations

import importlib.util
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager

import click

from workbench.core.errors import InputError

FIRST_PORT = 8501
STARTS_WITHIN_S = 60.0
ENDS_WITHIN_S = 5.0
EXIT_TERMINATED = 143


@click.command(name="app")
@click.option(
    "--port", type=click.IntRange(1, 65535), help=f"Port to listen on. Default: the first free one from {FIRST_PORT}."
)
@click.option(
    "--address",
    default="127.0.0.1",
    show_default=True,
    help="Address to listen on. The default is reachable from this computer only.",
)
@click.option(
    "--host", "hosts", multiple=True, help="Host name that a proxy forwards; may be repeated. Other names are rejected."
)
@click.option("--no-browser", is_flag=True, help="Open no browser window.")
def command(port: int | None, address: str, hosts: tuple[str, ...], no_browser: bool) -> int:
    """Open the dashboard in a browser: studies, comparison, loops, validation, diagnosis, batches.

    Ctrl-C ends it. The dashboard has no login: everybody who can reach the address can use it.
    """
    if importlib.util.find_spec("streamlit") is None:
        raise InputError("the dashboard needs the extra 'app'; from a checkout: pip install '.[app]'")
    chosen = _free_port(address) if port is None else port
    if port is not None and not _is_free(address, port):
        raise InputError(f"port {port} of {address} is taken or not ours to use; choose another", place="--port")
    url = f"http://{_shown(address)}:{chosen}"
    with _server(chosen, address, hosts) as server:
        _wait_for(f"http://{_reached(address)}:{chosen}/_stcore/health", server)
        try:
            click.echo(f"The dashboard runs at {url}; Ctrl-C ends it.")
            if not no_browser:
                _open(url)
            return server.wait()
        except KeyboardInterrupt:  # how it is meant to end: nothing has failed, and make shall not say so
            click.echo("\nThe dashboard has ended.")
            return 0


def _open(url: str) -> None:
    """Open a browser if there is one; the address was printed. The messages of xdg-open about missing browsers are
    suppressed, because they would push that line off the screen."""
    words = [sys.executable, "-c", "import sys, click; click.launch(sys.argv[1])", url]
    subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


@contextmanager
def _server(port: int, address: str, hosts: tuple[str, ...]) -> Iterator[subprocess.Popen[bytes]]:
    """The server as a child process; it is terminated at the end of the block, and killed if it does not end."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(EXIT_TERMINATED))  # so that the block ends then too
    words = [sys.executable, "-m", "workbench.dashboard.server", str(port), address, *hosts]
    # The address that streamlit would tell of is the one that it listens on, not the one to open.
    environment = {"STREAMLIT_LOGGER_LEVEL": "warning", **os.environ}
    server = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, env=environment)
    try:
        yield server
    finally:
        if server.poll() is None:
            server.terminate()
            try:
                server.wait(ENDS_WITHIN_S)
            except subprocess.TimeoutExpired:
                server.kill()
                server.wait()


def _wait_for(health: str, server: subprocess.Popen[bytes]) -> None:
    import urllib.error
    import urllib.request

    until = time.monotonic() + STARTS_WITHIN_S
    while time.monotonic() < until:
        if (ended := server.poll()) is not None:
            raise InputError(f"the dashboard's server ended with status {ended}; its own words stand above")
        try:
            with urllib.request.urlopen(health, timeout=1.0):
                return
        except (urllib.error.URLError, OSError):
            time.sleep(0.1)
    raise InputError(f"the dashboard's server did not answer within {STARTS_WITHIN_S:.0f} s")


def _is_free(address: str, port: int) -> bool:
    import socket

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


def _free_port(address: str) -> int:
    for port in range(FIRST_PORT, FIRST_PORT + 100):
        if _is_free(address, port):
            return port
    raise InputError(f"no free port from {FIRST_PORT} on; choose one", place="--port")


def _reached(address: str) -> str:
    """The address at which this computer reaches the server."""
    return {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(address, _shown(address))


def _shown(address: str) -> str:
    return f"[{address}]" if ":" in address else address
