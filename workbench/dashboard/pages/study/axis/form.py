"""The controls of the Study page for an axis, in the sidebar, in the axis' own units."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import streamlit as st

from workbench.control import Cascade
from workbench.dashboard import controller, session
from workbench.dashboard.pages.study.axis.desk import FED, AxisDesk, usual_desk, with_cascade, with_gains
from workbench.dashboard.pages.study.fields import forget_widgets, kept, slider
from workbench.errors import InputError
from workbench.figures.style import label
from workbench.kinds import kind_of
from workbench.machine import Axis
from workbench.references import BASELINE, planned_kinds

DESK = "study axis desk"
MOST = 1e9


def axis_controls(machine: Axis, bad: list[InputError], file: Callable[[str], str]) -> AxisDesk:
    """Draws the controls; what they stand at. file(name): draws the fields of the scenario file, returns the name."""
    whose = controller.owner(machine)
    desk = _desk(machine)
    if isinstance(elsewhere := controller.taken_over("study", whose), Cascade):
        desk = with_cascade(desk, elsewhere)
        forget_widgets([name for name in _names() if name not in ("way", "start", "dwell")])
    above, below = st.container(), st.container()
    with below:
        name = file(desk.base.name)
        desk = replace(desk, base=desk.base.model_copy(update={"name": name}))
    kind = kind_of(machine)
    with above:
        desk = replace(desk, references=_references(desk))
        with st.expander("Motion", expanded=True, icon=":material/swap_horiz:"):
            desk = _motion(desk, kind.moved.unit)
            desk = _limits(desk, kind.moved.unit, kind.looped.top_speed(machine).speed)
        with st.expander("Cascade: position over speed", expanded=True, icon=":material/tune:"):
            try:
                desk = with_cascade(desk, _cascade(desk.controller))
            except InputError as error:
                bad.append(error)
    session.put(DESK, desk)
    return desk


def _names() -> list[str]:
    return ["axis.kv", "axis.kp", "axis.ki", "axis.weight", *(f"axis.ff {name}" for name in FED)]


def _desk(machine: Axis) -> AxisDesk:
    """As the session has set it, where that suits this axis, too; else there and back under the controller by rule."""
    now = st.session_state.get(DESK)
    if isinstance(now, AxisDesk) and now.suits(machine):
        return now
    forget_widgets()
    return usual_desk(machine)


def _references(desk: AxisDesk) -> tuple[str, ...]:
    others = {name: kind for name, kind in planned_kinds().items() if name != BASELINE}
    chosen = st.pills(
        f"Against the {BASELINE}", list(others), selection_mode="multi",
        key=kept("axis.references", list(desk.references)), format_func=label,
        help="\n".join(f"- {kind.label}: {kind.definition}" for kind in others.values()),
    )  # fmt: skip
    return tuple(name for name in others if name in chosen)


def _motion(desk: AxisDesk, unit: str) -> AxisDesk:
    start = st.number_input(
        f"Start position ({unit})", -1e6, 1e6, key=kept("axis.start", desk.start), step=None, format="%.4g"
    )
    desk = replace(desk, start=float(start))
    if desk.own_moves:
        own = st.toggle("Moves as in the file", key=kept("axis.own", True))
        desk = replace(desk, own_moves=own)
        if own:
            return desk
    left, right = st.columns(2)
    way = left.number_input(
        f"There and back by ({unit})", -1e6, 1e6, key=kept("axis.way", desk.way), step=None, format="%.4g"
    )
    dwell = right.number_input("Rest (s)", 0.0, 600.0, key=kept("axis.dwell", desk.dwell_s), step=None, format="%.4g")
    return replace(desk, way=float(way), dwell_s=float(dwell))


def _about(value: float) -> float:
    """A round figure near a value, from which a slider's range is made."""
    return float(f"{value:.1g}") if value > 0.0 else 1.0


def _wide(words: str, name: str, value: float, base: float, tip: str | None = None, most: float = MOST) -> float:
    """A slider up to a few times what it began with, with a field in which anything may be typed."""
    about = _about(base)
    return slider(words, name, value, 0.0, min(4.0 * about, most), about / 50.0, "%.4g", tip, most=most)


def _limits(desk: AxisDesk, unit: str, top: float) -> AxisDesk:
    at, began = desk.limits, _began(desk)
    most = top if math.isfinite(top) else MOST
    speed = _wide(f"Limit speed ({unit}/s)", "axis.speed", min(at[0], most), began[0], most=most)
    acceleration = _wide(f"Limit acceleration ({unit}/s²)", "axis.acceleration", at[1], began[1])
    jerk = _wide(f"Limit jerk ({unit}/s³)", "axis.jerk", at[2], began[2], "The trapezoid has none.")
    return replace(desk, limits=(speed, acceleration, jerk))


def _began(desk: AxisDesk) -> tuple[float, ...]:
    """What the limits began with: the scenario's."""
    given = desk.base.limits.given()
    names = ("speed_m_s", "acceleration_m_s2", "jerk_m_s3")
    return tuple(given.get(name, now) for name, now in zip(names, desk.limits, strict=True))


def _cascade(now: Cascade) -> Cascade:
    kp_name, ki_name = now.GAINS
    kv = _wide("kv (1/s)", "axis.kv", now.kv_per_s, now.kv_per_s or 10.0, "0 is a speed loop alone.")
    kp = _wide(f"kp ({now.UNITS[0]})", "axis.kp", now.kp, now.kp)
    ki = _wide(f"ki ({now.UNITS[1]})", "axis.ki", now.ki, now.ki or now.kp)
    weight = slider("Set-point weight (–)", "axis.weight", now.set_point_weight, 0.0, 1.0, 0.05)
    ahead = {
        name: slider(f"Feed-forward of {name} (–)", f"axis.ff {name}", getattr(now.feed_forward, name), 0.0, 1.0, 0.05)
        for name in FED
    }
    values = {"kv_per_s": kv, kp_name: kp, ki_name: ki, "set_point_weight": weight, "feed_forward": ahead}
    return with_gains(now, values)
