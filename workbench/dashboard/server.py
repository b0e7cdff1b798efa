"""The dashboard's server: its options, the hosts it answers, what its answers may do in a browser.

    python -m workbench.dashboard.server PORT ADDRESS [HOST ...]

`app.py` makes the same server for `streamlit run app.py`, with the options of .streamlit/config.toml.
"""

from __future__ import annotations

import base64
import hashlib
import logging
import re
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import urlsplit

import streamlit as st
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

SCRIPT = Path(__file__).parent / "script" / "main.py"
HERE = ["localhost", "127.0.0.1", "::1"]
OPTIONS: dict[str, str | int | bool | list[str]] = {
    "server.address": "127.0.0.1",
    "server.allowedHosts": HERE,  # against DNS rebinding: a foreign name that is made to mean this computer
    "server.headless": True,  # the command opens the browser itself; streamlit would ask for an e-mail address
    "server.fileWatcherType": "none",
    "server.maxUploadSize": 64,
    "server.enableXsrfProtection": True,
    "browser.gatherUsageStats": False,
    "client.showErrorDetails": "type",
    "client.toolbarMode": "viewer",
    "theme.light.primaryColor": "#0072B2",
    "theme.light.backgroundColor": "#FFFFFF",
    "theme.light.secondaryBackgroundColor": "#F3F5F8",
    "theme.light.textColor": "#222222",
    "theme.dark.primaryColor": "#56B4E9",
    "theme.dark.backgroundColor": "#0E1117",
    "theme.dark.secondaryBackgroundColor": "#1D2330",
    "theme.dark.textColor": "#E8E8E8",
}
ASSETS = Path(__file__).parent / "assets"
PLOTLY = next(ASSETS.glob("plotly-*.min.js.gz")).stem
FOREVER = "public, immutable, max-age=31536000"  # the address holds the version
METRICS = "/_stcore/metrics"  # memory and sessions of everybody


def hosts_allowed(address: str, names: Sequence[str]) -> list[str]:
    """The hosts that a browser may call the server by. names: those that a proxy forwards.

    A server that listens to others and has no name is reached by any name, which nobody can know beforehand.
    """
    return [*HERE, *(names or ([] if address in HERE else ["*"]))]


def is_allowed(host: str, allowed: Sequence[str]) -> bool:
    """Whether a Host header names this server, as `server.allowedHosts` is read: `*` is any name, `*.x` a part of x."""
    try:
        name = urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return False
    return any(name == known or known == "*" or (known[:2] == "*." and name.endswith(known[1:])) for known in allowed)


def content_security_policy() -> str:
    """Nothing from elsewhere and no frame around it.

    Inline scripts of Streamlit's page and of the film are known by their hash. Streamlit runs a component's script from
    a blob and sets styles inline.
    """
    inline = [Path(st.__file__).parent / "static" / "index.html", Path(__file__).parents[1] / "view" / "film.html.j2"]
    scripts = [s for page in inline for s in re.findall(r"<script>(.*?)</script>", page.read_text("utf-8"), re.DOTALL)]
    digests = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts]
    known = " ".join(f"'sha256-{digest}'" for digest in digests)
    return (
        f"default-src 'self'; script-src 'self' blob: {known}; "
        "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; worker-src 'self' blob:; "
        "object-src 'none'; base-uri 'self'; form-action 'self'; frame-ancestors 'none'"
    )


class Guard:
    """Middleware: refuses foreign hosts and the metrics, and sends the security headers with every answer."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app
        self.headers = [
            (name.encode(), value.encode())
            for name, value in {
                "content-security-policy": content_security_policy(),
                "x-frame-options": "DENY",
                "x-content-type-options": "nosniff",
                "referrer-policy": "same-origin",  # an address ends in the id that finds a visitor's work
            }.items()
        ]
        self.ahead = (b"link", f"<./{PLOTLY}>; rel=modulepreload; fetchpriority=low".encode())

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Of one request. Streamlit checks the host of a WebSocket by itself."""
        if scope["type"] != "http":
            return await self.app(scope, receive, send)

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = {name for name, _ in self.headers}
                kept = [pair for pair in message.get("headers", []) if pair[0].lower() not in own]
                is_page = any(name.lower() == b"content-type" and said.startswith(b"text/html") for name, said in kept)
                # The browser fetches the library while the script still computes what is to be drawn. A report that is
                # downloaded is HTML too and needs none.
                ahead = [self.ahead] if is_page and "/media/" not in str(scope["path"]) else []
                message = {**message, "headers": [*kept, *self.headers, *ahead]}
            await send(message)

        host = next((value.decode("latin-1") for name, value in scope["headers"] if name == b"host"), "")
        if not is_allowed(host, st.get_option("server.allowedHosts") or ["*"]):
            answer = PlainTextResponse("This server does not answer to that name; its owner can allow it.", 400)
            return await answer(scope, receive, guarded)
        if str(scope["path"]).endswith(METRICS):
            return await PlainTextResponse("Not found", 404)(scope, receive, guarded)
        return await self.app(scope, receive, guarded)


def _plotly(request: Request) -> FileResponse:
    """plotly.js without maps and solids, a third of the Python package's own, which a browser reads a third as long; in
    its version. Packed already: Streamlit would pack it for each visitor, and answer nothing else meanwhile."""
    headers = {"Cache-Control": FOREVER, "Content-Encoding": "gzip"}
    return FileResponse(ASSETS / f"{PLOTLY}.gz", media_type="text/javascript", headers=headers)


def routes() -> list[Route]:
    return [Route(f"/{PLOTLY}", _plotly)]


def middleware() -> list[Middleware]:
    return [Middleware(Guard)]


def warm() -> None:
    """Compiles the kernels and runs the first study in a thread, while the browser still starts."""

    def load() -> None:
        try:
            from workbench.dashboard.pages.study import run_first

            run_first()
        except Exception:  # what fails here fails again, and is shown, on the page
            logging.getLogger(__name__).exception("loading ahead of time failed")

    thread = threading.Thread(target=load, name="warm", daemon=True)
    # Streamlit warns of its spinner, which has no page yet, and says that this is to be ignored.
    of_streamlit = logging.getLogger("streamlit.runtime.scriptrunner_utils.script_run_context")
    of_streamlit.addFilter(lambda _: threading.current_thread() is not thread)
    thread.start()


def main(port: str, address: str, *hosts: str) -> None:
    """Serves until it is stopped."""
    from streamlit.starlette import App

    warm()
    own = {"server.port": int(port), "server.address": address, "server.allowedHosts": hosts_allowed(address, hosts)}
    App(SCRIPT, routes=routes(), middleware=middleware()).run(config=OPTIONS | own)


if __name__ == "__main__":
    main(*sys.argv[1:])
