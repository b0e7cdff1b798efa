"""`python -m workbench.dashboard.serve PORT ADDRESS [HOST ...]`: the server in this process, until it is stopped."""

from __future__ import annotations

import sys
from pathlib import Path

from workbench.dashboard.options import flags, hosts_allowed
from workbench.dashboard.warm import warm

SCRIPT = Path(__file__).parent / "script" / "main.py"


def main(port: str, address: str, *hosts: str) -> None:
    """Runs streamlit; does not return."""
    from streamlit.web import cli

    warm()
    allowed = hosts_allowed(address, hosts)
    own = flags({"server.port": int(port), "server.address": address, "server.allowedHosts": allowed})
    sys.argv = ["streamlit", "run", str(SCRIPT), *own]
    cli.main()


if __name__ == "__main__":
    main(*sys.argv[1:])
