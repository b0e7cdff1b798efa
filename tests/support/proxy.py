"""The headers that the documented proxies add to what the dashboard's server answers."""

from __future__ import annotations

import re
from pathlib import Path

_PAGE = Path(__file__).resolve().parents[2] / "docs" / "dashboard.md"


def documented_headers() -> dict[str, dict[str, str]]:
    """By proxy, nginx and Caddy: each header's name and value as docs/dashboard.md has them."""
    text = _PAGE.read_text(encoding="utf-8")
    nginx = re.findall(r'^ *add_header (\S+) "?([^"\n]+?)"? always;$', text, re.MULTILINE)
    block = re.search(r"^ *header \{\n(.*?)^ *\}", text, re.MULTILINE | re.DOTALL)
    assert block is not None
    return {"nginx": dict(nginx), "Caddy": dict(re.findall(r'^ *(\S+) "?([^"\n]+?)"?$', block[1], re.MULTILINE))}
