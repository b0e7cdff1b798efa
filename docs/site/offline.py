"""The built pages have to show whole without a network: what they load lies beside them, or the build fails."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

LOADS = re.compile(
    r"""<(?:script|img|iframe|source|link|video|audio)\b[^>]*?\b(?:src|srcset|href)=["']?((?:https?:)?//[^"'\s>]+)"""
    r"""|url\(["']?((?:https?:)?//[^"')]+)|@import\s+["']((?:https?:)?//[^"']+)"""
)


def loaded(text: str) -> list[str]:
    """Addresses elsewhere that a browser would fetch by itself; a link that a reader follows is none."""
    return [next(filter(None, hit.groups())) for hit in LOADS.finditer(text)]


def check(app: Sphinx, failure: Exception | None) -> None:
    if failure or app.builder.format != "html":
        return
    files = [p for p in Path(app.outdir).rglob("*") if p.suffix in {".html", ".css", ".svg"}]
    found = [f"{p.name} loads {address}" for p in files for address in loaded(p.read_text(encoding="utf-8"))]
    if found:
        from sphinx.errors import ExtensionError

        raise ExtensionError("the pages need a network: " + "; ".join(sorted(found)[:10]))


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("build-finished", check)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
