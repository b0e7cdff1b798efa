"""Fields of the Study page, whose values stay while other pages are looked at."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import streamlit as st


def kept(name: str, value: Any) -> str:
    """The key of a widget that starts, and after another page starts again, at this value."""
    key = f"study.{name}"
    if key not in st.session_state:
        st.session_state[key] = value
    return key


def forget_widgets(names: Sequence[str] = ()) -> None:
    """Of all controls, or of some."""
    keys = [f"study.{name}" for name in names] or [str(k) for k in st.session_state if str(k).startswith("study.")]
    for key in keys:
        st.session_state.pop(key, None)


def slider(
    words: str,
    name: str,
    value: float,
    low: float,
    high: float,
    step: float,
    form: str = "%.2f",
    tip: str | None = None,
    most: float | None = None,
) -> float:
    """A slider whose range takes in the value it is given, with a field beside it in which others may be typed.

    most: what may be typed at most; the slider's end where nothing is said.
    """
    key = kept(name, value)
    now = float(st.session_state[key])
    typed, end = f"{key} typed", high if most is None else most
    reached = (value, now) if most is not None else (value,)
    low, high = min(low, *reached), max(high, *reached)
    st.session_state[key] = st.session_state[typed] = min(max(now, low), high)
    if low == high:  # nothing to slide
        return low

    def take() -> None:
        st.session_state[key] = float(st.session_state[typed])

    left, right = st.columns([1.4, 1.0], vertical_alignment="bottom")
    with right:
        st.number_input(
            f"{words}, typed", 0.0 if most is not None else low, max(end, high), key=typed, step=None, format="%.4g",
            on_change=take, label_visibility="collapsed",
        )  # fmt: skip
    with left:
        return float(st.slider(words, low, high, step=step, format=form, key=key, help=tip or None))
