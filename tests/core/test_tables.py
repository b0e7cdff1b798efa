"""Tables and their forms, small numbers in a text, records in JSON."""

from __future__ import annotations

import json
from dataclasses import dataclass
from enum import StrEnum
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from workbench.core.json_records import plain, rounded
from workbench.core.names import powers
from workbench.core.numbers import figures, signed, whole_percent, with_error
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


# Small numbers in a text, as people write them.


@pytest.mark.parametrize(
    ("python", "people"),
    [
        ("8.2e-05 N m", "82·10⁻⁶ N m"),
        ("82.0e-6 and 1.2e-6", "82.0·10⁻⁶ and 1.2·10⁻⁶"),
        ("from 0.0012 to 8e-05.", "from 0.0012 to 80·10⁻⁶."),
        ("-5.03e-08", "-50.3·10⁻⁹"),
        ("2.5e+05 of 89.0e9", "250000 of 89.0·10⁹"),
        ("1.5e-4", "0.00015"),
    ],
)
def test_a_number_in_powers_of_ten_keeps_value_and_digits(python: str, people: str):
    assert powers(python) == people


def test_names_are_left_alone():
    assert powers("run_2e3, a2e5, 2e5b and 1.2.3e4") == "run_2e3, a2e5, 2e5b and 1.2.3e4"


# Records in JSON: plain values in their order, significant digits, null for what is no finite number.


class Word(StrEnum):
    YES = "yes"


@dataclass(frozen=True)
class Inner:
    value: float
    names: tuple[str, ...] = ("a", "b")


@dataclass(frozen=True)
class Outer:
    inner: Inner
    angle: np.ndarray
    word: Word = Word.YES
    many: int = 1234567
    flag: bool = True


def test_a_record_becomes_mappings_lists_and_numbers_in_its_own_order():
    said = plain(Outer(Inner(1.23456789), np.array([[1.0, np.nan], [np.inf, 2.0 / 3.0]])), 3)
    assert json.dumps(said) == (
        '{"inner": {"value": 1.23, "names": ["a", "b"]}, "angle": [[1.0, null], [null, 0.667]], '
        '"word": "yes", "many": 1234567, "flag": true}'
    )


def test_what_has_no_form_in_json_is_refused():
    with pytest.raises(Exception, match="object has no form in JSON"):
        plain({"a": object()})


@given(st.floats(), st.integers(1, 12))
def test_rounding_keeps_the_digits_asked_for_and_is_its_own_fixed_point(value: float, digits: int):
    once = rounded(value, digits)
    assert (once is None) == (not np.isfinite(value))
    if once is not None:
        assert rounded(once, digits) == once  # also where it would be beyond the largest float
        assert once == pytest.approx(value, rel=0.51 * 10.0 ** (1 - digits))


@given(st.floats(-9e5, 9e5), st.integers(0, 3))
def test_a_change_shows_its_sign_but_for_a_zero(value: float, decimals: int):
    text = signed(value, decimals)
    assert float(text) == pytest.approx(value, abs=0.5001 * 10.0**-decimals)
    assert (text[0] in "+-") == (float(text) != 0.0)


@given(st.floats(1e-3, 9.4e5), st.integers(1, 4))
def test_figures_are_as_many_as_asked_for_and_without_an_exponent(value: float, digits: int):
    text = figures(value, digits)
    assert "e" not in text and float(text) == pytest.approx(value, rel=0.5001 * 10.0 ** (1 - digits))
    assert len(text.replace(".", "").lstrip("0")) >= digits
    assert "e" not in with_error(value, 0.1 * value)[0]


def test_no_estimated_share_is_said_to_be_all():
    assert [whole_percent(share) for share in (0.0, 0.994, 0.9999, 1.0)] == ["0 %", "99 %", "over 99 %", "over 99 %"]
