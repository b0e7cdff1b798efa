"""What draws figures, tables and controls, sent to the browser with the page rather than asked for with the first of
them.

Streamlit's page names the scripts that it begins with. Here those of its elements and what these import are named, too:
the browser fetches and reads them while the server computes. Without this (`streamlit run app.py`) each is asked for
when needed.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import re
from collections.abc import MutableMapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

# Its scripts for what the first page shows: their names go on with a hash.
OF_STREAMLIT = (
    "BidiComponent", "Button", "ButtonGroup", "Checkbox", "DataFrame", "DownloadButton", "FileUploader", "Html",
    "Metric", "Multiselect", "NumberInput", "Selectbox", "Slider", "TextInput", "arrowFormatUtils",
)  # fmt: skip
_IMPORTED = re.compile(r'(?:from|import)"\./([^"]+\.js)"')  # statically: fetched before the script can run
# Fetched and read beside what comes first, run when asked for. Relative addresses: a proxy may put a path before them.
_AHEAD = 'rel="modulepreload" crossorigin fetchpriority="low"'
FOREVER = "public, immutable, max-age=31536000"  # its address holds its version


def library() -> Path:
    """The library as the Python package has it: figure and drawing are of one version."""
    plotly = importlib.util.find_spec("plotly")
    assert plotly is not None and plotly.submodule_search_locations
    return Path(plotly.submodule_search_locations[0]) / "package_data" / "plotly.min.js"


def streamlit_scripts() -> list[str]:
    """The names of streamlit's scripts for what the first page shows, and of all that they import."""
    streamlit = importlib.util.find_spec("streamlit")
    assert streamlit is not None and streamlit.submodule_search_locations
    folder = Path(streamlit.submodule_search_locations[0]) / "static" / "static" / "js"
    wanted = [file.name for stem in OF_STREAMLIT for file in sorted(folder.glob(f"{stem}.*.js"))]
    named: dict[str, None] = {}
    while wanted:
        name = wanted.pop(0)
        if name not in named and (folder / name).is_file():
            named[name] = None
            wanted += _IMPORTED.findall((folder / name).read_text(encoding="utf-8"))
    return list(named)


class LoadAhead:
    """Middleware that serves the library and names it in each page."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app
        self.name = f"plotly-{importlib.metadata.version('plotly')}.min.js"
        scripts = streamlit_scripts()
        ours = f'<link id="plotly-library" {_AHEAD} href="./{self.name}">'
        theirs = [f'<link {_AHEAD} href="./static/js/{file}">' for file in scripts]
        self.tag = "".join([ours, *theirs, "</head>"]).encode()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Of one request."""
        path = str(scope.get("path", "")).rpartition("/")[2] if scope["type"] == "http" else "."
        if path == self.name:
            from starlette.responses import FileResponse

            answer = FileResponse(library(), media_type="text/javascript", headers={"Cache-Control": FOREVER})
            await answer(scope, receive, send)
        elif "." in path:
            await self.app(scope, receive, send)
        else:
            await self.app(scope, receive, _Named(send, self.tag))


class _Named:
    """Sends an answer on; a whole HTML page with the tag at the end of its head."""

    def __init__(self, send: Send, tag: bytes) -> None:
        self.send, self.tag = send, tag
        self.start: MutableMapping[str, Any] | None = None  # held back until the body's length is known
        self.body = b""

    async def __call__(self, message: Message) -> None:
        if message["type"] == "http.response.start" and _is_page(message):
            self.start = message
        elif self.start is None or message["type"] != "http.response.body":
            await self.send(message)
        else:
            self.body += message.get("body", b"")
            if not message.get("more_body", False):
                body = self.body.replace(b"</head>", self.tag, 1)
                kept = [pair for pair in self.start["headers"] if pair[0].lower() != b"content-length"]
                length = (b"content-length", str(len(body)).encode())
                await self.send({**self.start, "headers": [*kept, length]})
                await self.send({"type": "http.response.body", "body": body})


def _is_page(message: Message) -> bool:
    headers = {name.lower(): value for name, value in message["headers"]}
    plain = b"content-encoding" not in headers
    return message["status"] == 200 and plain and headers.get(b"content-type", b"").startswith(b"text/html")
