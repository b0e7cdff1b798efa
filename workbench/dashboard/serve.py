"""`python -m workbench.dashboard.serve PORT ADDRESS [HOST ...]`: the server in this process, until it is stopped."""

from __future__ import annotations

import sys
from pathlib import Path

from workbench.dashboard.ahead import LoadAhead
from workbench.dashboard.options import OPTIONS, hosts_allowed
from workbench.dashboard.warm import warm

SWITCH_S = 2e-4
SCRIPT = Path(__file__).parent / "script" / "main.py"


def main(port: str, address: str, *hosts: str) -> None:
    """Runs streamlit; does not return."""
    from starlette.middleware import Middleware
    from streamlit.components.v2.component_manager import BidiComponentManager
    from streamlit.starlette import App

    # Python's 5 ms would pass between a browser's request and its answer while the first study's imports run beside it.
    sys.setswitchinterval(SWITCH_S)
    warm()
    # It would read what every installed package says of itself, half a second of the first page; ours it is told of.
    BidiComponentManager.discover_and_register_components = _nothing  # type: ignore[method-assign]
    own = {"server.port": int(port), "server.address": address, "server.allowedHosts": hosts_allowed(address, hosts)}
    App(SCRIPT, middleware=[Middleware(LoadAhead)]).run(config=OPTIONS | own)


def _nothing(*_: object, **__: object) -> None:
    """In place of a search for components in the installed packages."""


if __name__ == "__main__":
    main(*sys.argv[1:])
