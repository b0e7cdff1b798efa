"""`python -m workbench.dashboard.serve PORT ADDRESS`: the dashboard's server in this process, until it is stopped."""

from __future__ import annotations

import sys
from pathlib import Path

from workbench.dashboard.options import flags
from workbench.dashboard.warm import warm


def main(port: str, address: str) -> None:
    """Runs streamlit; does not return."""
    from streamlit.web import cli

    warm()
    script = Path(__file__).with_name("main.py")
    sys.argv = ["streamlit", "run", str(script), *flags({"server.port": int(port), "server.address": address})]
    cli.main()


if __name__ == "__main__":
    main(*sys.argv[1:3])
