"""One self-contained page of figures: the only place here that writes a file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><meta name="generator" content="{generator}">
<style>
 body {{ font-family: "DejaVu Sans", "Segoe UI", Arial, sans-serif; color: #222; background: white;
        margin: 0 auto; max-width: 1500px; padding: 8px 16px; }}
 p.lead {{ font-size: 15px; line-height: 1.45; margin: 8px 16px; max-width: 75em; }}
 p.caption {{ font-size: 12px; color: #555; margin: 0 16px 16px; max-width: 92em; }}
 p.answer {{ font-size: 18px; line-height: 1.4; margin: 12px 16px; padding: 8px 14px; max-width: 62em;
            background: #F3F6F9; border-left: 5px solid #0072B2; }}
 h1 {{ font-size: 20px; margin: 12px 16px 4px; }}
 h2 {{ font-size: 17px; margin: 34px 16px 6px; padding-bottom: 3px; border-bottom: 1px solid #bbb; }}
 table {{ border-collapse: collapse; font-size: 13px; margin: 12px 16px; }}
 th, td {{ text-align: right; padding: 3px 10px; border-bottom: 1px solid #ddd; }}
 th {{ vertical-align: bottom; border-bottom: 1.5px solid #666; white-space: pre-line; }}
 td {{ white-space: nowrap; }} td.text {{ white-space: normal; }}
 th.text, td.text {{ text-align: left; }} td.short {{ white-space: nowrap; }}
 ul.lead {{ font-size: 15px; line-height: 1.45; margin: 8px 16px; max-width: 75em; padding-left: 20px; }}
 ul.lead li {{ margin-bottom: 3px; }}
 code {{ font-family: "DejaVu Sans Mono", Consolas, monospace; font-size: 0.93em; }}
 .table {{ overflow-x: auto; }}
 @page {{ size: A4; margin: 12mm; }}
 @media print {{
  body {{ max-width: none; padding: 0; }}
  .figure, tr {{ break-inside: avoid; }}
  h2 {{ font-size: 14px; margin: 18px 0 4px; break-after: avoid; }}
  p.answer {{ font-size: 14px; margin: 8px 0; print-color-adjust: exact; -webkit-print-color-adjust: exact; }}
  thead {{ display: table-header-group; }}
  table {{ font-size: 8.5px; margin: 8px 0; }} th, td {{ padding: 2px 4px; }}
  .table {{ overflow: visible; }}
  p.lead, ul.lead {{ font-size: 12px; margin: 6px 0; }} h1 {{ margin: 0 0 4px; }}
  p.caption {{ font-size: 10px; margin: 0 0 10px; }}
  .modebar-container {{ display: none; }}
 }}
</style>
<script>{plotly_js}</script></head><body>
{body}
<script>
// Paper is narrower than a screen: figures are drawn anew for it, and back.
const drawn = layout => document.querySelectorAll(".plotly-graph-div").forEach(f => Plotly.relayout(f, layout));
window.addEventListener("beforeprint", () => drawn({{autosize: false, width: 700}}));
window.addEventListener("afterprint", () => drawn({{autosize: true, width: null}}));
</script>
</body></html>
"""


SHORT = 28  # characters of a table's words that are not broken

Table = tuple[Sequence[str], Sequence[Sequence[str]], str]  # head, rows, caption


def save(
    figures: Figure | Sequence[Figure],
    path: Path,
    title: str = "workbench",
    sentences: Sequence[str] = (),
    table: tuple[Sequence[str], Sequence[Sequence[str]]] | None = None,
    caption: str = "",
    more_tables: Sequence[Table] = (),
    figure_notes: Sequence[str] = (),
    points: Sequence[str] = (),
    generator: str = "workbench",
) -> None:
    """Write a page that needs no network: a few lines of plain text, points as a list, tables, then the figures.

    table: head and rows as text, with a caption below; a column whose head starts with a blank holds
    words and is set left. more_tables come after it. figure_notes: a line below each figure, in their order.
    """
    listed = list(figures) if isinstance(figures, list | tuple) else [figures]
    first: list[Table] = [] if table is None else [(*table, caption)]
    notes = [*figure_notes, *[""] * len(listed)]
    body = [
        f"<h1>{escape(title)}</h1>",
        *_words(sentences, points),
        *(_captioned(each) for each in [*first, *more_tables]),
        *([_caption(caption)] if table is None else []),
        *(_drawn(number, figure, note) for number, (figure, note) in enumerate(zip(listed, notes, strict=False), 1)),
    ]
    _write(path, title, body, generator)


@dataclass(frozen=True)
class Section:
    """A part of a longer page, in this order: heading (none where empty), sentences, points, tables, figures.

    figures: each with a line below it.
    """

    heading: str
    sentences: Sequence[str] = ()
    points: Sequence[str] = ()
    tables: Sequence[Table] = ()
    figures: Sequence[tuple[Figure, str]] = ()


def save_sections(
    sections: Sequence[Section], path: Path, title: str, answer: str = "", generator: str = "workbench"
) -> None:
    """Write a page of several sections that needs no network; answer: one line that stands out at the top."""
    body = [f"<h1>{escape(title)}</h1>"]
    if answer:
        body.append(f'<p class="answer">{escape(answer)}</p>')
    number = 0
    for section in sections:
        if section.heading:
            body.append(f"<h2>{escape(section.heading)}</h2>")
        body += _words(section.sentences, section.points)
        body += [_captioned(table) for table in section.tables]
        for figure, note in section.figures:
            number += 1
            body.append(_drawn(number, figure, note))
    _write(path, title, body, generator)


def _write(path: Path, title: str, body: Sequence[str], generator: str) -> None:
    from plotly.offline import get_plotlyjs

    page = _PAGE.format(
        title=escape(title), generator=escape(generator), plotly_js=get_plotlyjs(), body="\n".join(body)
    )
    path.write_text(page, encoding="utf-8")


def _words(sentences: Sequence[str], points: Sequence[str]) -> list[str]:
    parts = [f'<p class="lead">{_text(sentence)}</p>' for sentence in sentences]
    if points:
        parts.append(f'<ul class="lead">{"".join(f"<li>{_text(point)}</li>" for point in points)}</ul>')
    return parts


def _text(sentence: str) -> str:
    """Escaped; what stands in backticks is set as code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(sentence))


def _caption(text: str) -> str:
    return f'<p class="caption">{escape(text)}</p>' if text else ""


def _drawn(number: int, figure: Figure, note: str) -> str:
    from plotly.io import to_html

    # A fixed id instead of a random one: the same figures give the same bytes.
    html = to_html(
        figure,
        include_plotlyjs=False,
        full_html=False,
        div_id=f"figure-{number}",
        config={"responsive": True, "displaylogo": False},
    )
    return f'<div class="figure">{html}{_caption(note)}</div>'


def _captioned(table: Table) -> str:
    head, rows, below = table
    return f"{_table(head, rows)}\n{_caption(below)}"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    kinds = ["text" if name.startswith(" ") else "" for name in head]

    def cells(tag: str, values: Sequence[str]) -> str:
        pairs = zip(kinds, map(str.strip, values), strict=True)
        return "".join(f"<{tag}{_class(kind, value)}>{escape(value)}</{tag}>" for kind, value in pairs)

    body = "".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    return f'<div class="table"><table><thead><tr>{cells("th", head)}</tr></thead><tbody>{body}</tbody></table></div>'


def _class(kind: str, value: str) -> str:
    if not kind:
        return ""
    return f' class="{kind} short"' if len(value) <= SHORT else f' class="{kind}"'
