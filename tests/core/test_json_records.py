"""Records in JSON: plain values in their order, significant digits, null for what is no finite number."""

from __future__ import annotations

import json
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from workbench.core.json_records import plain, rounded


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
