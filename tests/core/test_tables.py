"""The record of a table: what fits into it, and its forms as text, Markdown and HTML."""

from __future__ import annotations

from html.parser import HTMLParser

import pytest
from hypothesis import given
from hypothesis import strategies as st

from workbench.core.table import Column, Table, words
from workbench.core.templates import Sentences

TABLE = Table(
    [words("run"), Column("speed error\nopen loop", "%"), Column("proba-\nbility")],
    [["full <&> fast", "1.00", "0.9"], ["empty", "–", "0.1"]],
    "What | means.",
)


class Cells(HTMLParser):
    """The texts of a table's cells, row by row."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.inside = False
        self.feed(html)

    def handle_starttag(self, tag: str, attributes: object) -> None:
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")
            self.inside = True
        elif tag == "br":
            self.rows[-1][-1] += "\n"

    def handle_endtag(self, tag: str) -> None:
        self.inside = self.inside and tag not in ("td", "th")

    def handle_data(self, data: str) -> None:
        if self.inside:
            self.rows[-1][-1] += data


def test_html_holds_each_cell_escaped_and_the_note():
    html = TABLE.html()
    assert "full &lt;&amp;&gt; fast" in html
    assert '<p class="caption">What | means.</p>' in html
    assert Cells(html).rows[0] == ["run", "speed error\nopen loop\n%", "proba-\nbility\n\u00a0"]
    assert Cells(html).rows[1:] == [list(row) for row in TABLE.rows]


CELL = st.text(st.characters(codec="utf-8", exclude_characters="\r\x00"), max_size=8)


@given(st.lists(st.lists(CELL, min_size=2, max_size=2), max_size=3))
def test_whatever_a_cell_says_html_says_it_back_and_nothing_else(rows: list[list[str]]):
    html = Table([words("a"), Column("b")], rows).html()
    assert Cells(html).rows[1:] == [[cell.strip() for cell in row] for row in rows]


def test_a_narrow_table_wraps_the_heads_of_numbers_and_cuts_words_but_no_number():
    heads = ("feed forward inertia", "feed forward weight", "torque peak")
    table = Table(
        [words("reference"), *(Column(head, "N m") for head in heads)], [["trapezoid", "1.00", "0.50", "595.6"]]
    )
    lines = table.text(44).splitlines()
    assert max(map(len, lines)) <= 44
    assert {"1.00", "0.50", "595.6"} <= set(lines[-1].split())
    assert [line.count("forward") for line in lines].count(2) == 1


def test_a_sentence_of_a_template_is_one_line_and_empty_lines_part_sentences():
    said = Sentences("view/blind_words.j2")
    first, second = said.each("sheet", ["003", "7 < 9"], True)
    assert first == "No diagnosis came of 003, 7 < 9; counted as wrong."  # plain text: nothing is escaped
    assert second.startswith("All campaigns come from the plant's own equations") and "\n" not in second
    assert said.sheet([], False) == ""
    with pytest.raises(AttributeError):
        said.no_such_sentence()
