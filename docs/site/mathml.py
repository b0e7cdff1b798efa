"""Equations as MathML, made when the site is built: a browser draws it itself, without a script or a font to fetch."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.util import logging

LOG = logging.getLogger(__name__)


def mathml(latex: str, display: str, where: nodes.Node) -> str:
    """The MathML element of a formula; what would not be drawn as meant is a warning, and so fails the build."""
    made: str = convert(latex, display=display)
    # A command that the converter does not know; an alphabet that browsers do not know (write \mathcal{E} with braces).
    if "\\" in made or "mathvariant" in made:
        LOG.warning("a formula holds something that MathML cannot be made of: %s", latex, location=where)
    return made


def visit_inline(translator: Any, node: nodes.math) -> None:
    translator.body.append(mathml(node.astext(), "inline", node))
    raise nodes.SkipNode


def visit_block(translator: Any, node: nodes.math_block) -> None:
    translator.body.append(f'<div class="math">{mathml(node.astext(), "block", node)}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
