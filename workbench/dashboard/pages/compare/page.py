"""The page Compare: kept runs side by side, their signals over one another and their metrics with differences."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import streamlit as st

from workbench.control import PiSettings
from workbench.dashboard.pages.compare.kept import Kept, forget, kept
from workbench.dashboard.widgets import SAME, chart, plain, text
from workbench.figures.study import MOST_COLUMNS, overview
from workbench.figures.study_plane import torque_speed_plane
from workbench.figures.style import label
from workbench.machine import Hoist
from workbench.metrics import Metric, View, shown_in
from workbench.run import Run
from workbench.study.execute.run import motor_torque_limit_nm
from workbench.study.results.row import Row
from workbench.study.scenario.standalone import standalone_text

MOST_SAID = 3  # values by which a machine is told from another of its name


def show() -> None:
    """Draws the page."""
    runs = kept()
    if not runs:
        st.info("Nothing is kept yet. On the page Study, set something up and press **Keep for Compare**.")
        return
    chosen, baseline, kind = _choice(runs)
    _list(runs)
    if not chosen:
        st.info("Choose at least one of the kept studies.")
        return
    payloads = _payloads(chosen, kind)
    if not payloads:
        st.info("These studies have no payload in common for this reference.")
        return
    _table(chosen, baseline, kind, payloads)
    _figures(chosen, kind, payloads)


def _choice(runs: Mapping[str, Kept]) -> tuple[list[Kept], Kept, str]:
    with st.sidebar:
        names = st.multiselect("Side by side", list(runs), default=list(runs), key="compare names")
        first = names or list(runs)
        baseline = st.selectbox("Differences to", first, key="compare baseline")
        kinds = [kind for name in first for kind in runs[name].result.study.scenario.kinds]
        common = list(dict.fromkeys(kinds))
        usual = common.index("ruckig") if "ruckig" in common else 0
        kind = st.radio("Reference", common, index=usual, format_func=label, key="compare reference")
    chosen = [runs[name] for name in names if name in runs]
    return chosen, runs[baseline], kind


def _list(runs: Mapping[str, Kept]) -> None:
    """Each kept study with its settings, to save or to remove."""
    with st.expander(f"{len(runs)} kept", expanded=False, icon=":material/inventory_2:"):
        for name, study in runs.items():
            words, saving, removing = st.columns([6, 1.2, 1.2], vertical_alignment="center")
            words.markdown(f"**{plain(name)}** · {plain(_settings(study))}")
            saving.download_button(
                "Save", standalone_text(study.scenario, study.machine), file_name=f"{study.scenario.name}.yaml",
                mime="application/yaml", key=f"compare save {name}", on_click="ignore", width="stretch",
            )  # fmt: skip
            if removing.button("Remove", key=f"compare remove {name}", width="stretch"):
                forget(name)
                st.rerun()


def _settings(study: Kept) -> str:
    loop = study.scenario.controller
    gains = f"kp {loop.kp_nm_s_per_rad:g} N m s/rad, ki {loop.ki_nm_per_rad:g} N m/rad"
    return f"{study.machine.name}: {', '.join(said for said in (limits_text(study), gains) if said)}"


def limits_text(study: Kept) -> str:
    limits = study.scenario.limits
    said = [f"{limits.speed_m_s:g} m/s", f"{limits.acceleration_m_s2:g} m/s²"] if limits.speed_m_s else []
    return ", ".join([*said, f"{limits.jerk_m_s3:g} m/s³"] if limits.jerk_m_s3 else said)


def _settings_rows(columns: Sequence[Kept]) -> list[tuple[str, list[str]]]:
    """The machine of each study, and limits, gains and model where they differ."""
    machines = [machine_told_apart(study, columns) for study in columns]
    rows = [("machine", machines)]
    for what, say in (
        ("limits", lambda study: limits_text(study)),
        ("kp, ki", lambda study: f"{_loop(study).kp_nm_s_per_rad:g}, {_loop(study).ki_nm_per_rad:g}"),
        ("model", lambda study: study.scenario.plant),
    ):
        said = [say(study) for study in columns]
        if len(set(said)) > 1:
            rows.append((what, said))
    return rows


def machine_told_apart(study: Kept, columns: Sequence[Kept]) -> str:
    """The machine's name; of machines of one name, what is other than in the first."""
    own, first = study.result.study.machine, columns[0].result.study.machine
    if own == first or own.name != first.name:
        return own.name
    mine, others = values_of(own), values_of(first)
    other = [f"{name.replace('_', ' ')} {value:.4g}" for name, value in mine.items() if others.get(name) != value]
    effects = [name for name in own.effects if own.effects[name] != first.effects.get(name)]
    said = ", ".join([*other[:MOST_SAID], *effects[:MOST_SAID]]) or "without effects of the first"
    return f"{own.name}: {said}"


def values_of(machine: Hoist) -> dict[str, float]:
    """Dotted name -> number, of all but what the machine is identified by."""
    values: dict[str, float] = {}

    def walk(data: Mapping[str, Any], before: str) -> None:
        for key, value in data.items():
            if isinstance(value, Mapping):
                walk(value, f"{before}{key}.")
            elif isinstance(value, int | float):
                values[f"{before}{key}"] = float(value)

    walk(machine.model_dump(exclude={"effects", "identified"}), "")
    return values


def _loop(study: Kept) -> PiSettings:
    return study.result.study.scenario.controller


def _payloads(chosen: Sequence[Kept], kind: str) -> list[float]:
    """Those that all of the chosen studies have run with this reference."""
    offered = [{row.payload_kg for row in one.result.rows if row.ok and row.reference == kind} for one in chosen]
    return sorted(set.intersection(*offered))


def _row(study: Kept, kind: str, payload_kg: float) -> Row:
    return next(row for row in study.result.rows if row.ok and row.reference == kind and row.payload_kg == payload_kg)


def _table(chosen: Sequence[Kept], baseline: Kept, kind: str, payloads: Sequence[float]) -> None:
    payload = payloads[-1]
    if len(payloads) > 1:
        payload = st.segmented_control(
            "Payload", payloads, default=payload, format_func=lambda kg: f"{kg:g} kg", key="compare payload",
            required=True,
        ) or payload  # fmt: skip
    columns = [baseline, *(study for study in chosen if study.name != baseline.name)]
    rows = [_row(study, kind, payload) for study in columns]
    table: dict[str, list[str]] = {"": [], plain(baseline.name): []}
    table |= {plain(study.name): [] for study in columns[1:]}
    for what, said in _settings_rows(columns):
        table[""].append(what)
        for study, words in zip(columns, said, strict=True):
            table[plain(study.name)].append(plain(words))
    for metric in shown_in(View.COMPARE):
        if not all(row.metrics.get(metric.name) is not None for row in rows):
            continue
        values = [metric.scale * row[metric.name] for row in rows]
        unit = metric.shown_unit
        table[""].append(plain(f"{metric.title} ({unit})" if unit else metric.title))
        for study, value in zip(columns, values, strict=True):
            cell = text(value)
            if study.name != baseline.name:
                cell += difference(value, values[0], metric)
            table[plain(study.name)].append(cell)
    st.table(table, hide_index=True)
    st.caption(f"{label(kind).capitalize()}, {payload:g} kg. In brackets the difference to {plain(baseline.name)}.")


def difference(value: float, base: float, metric: Metric) -> str:
    """The difference in brackets, green where it is better and red where it is worse; `=` for one too small to see.

    value, base: in the unit that is shown.
    """
    by = value - base
    rounding = abs(by) <= SAME * max(abs(base), abs(value)) and text(value) == text(base)
    if not math.isfinite(by) or rounding or abs(by) < metric.visible * metric.scale:
        return " (=)"
    worse = metric.worse_by(base, value) if metric.better is not None else 0.0
    colour = "red" if worse > 0.0 else "green" if worse < 0.0 else "gray"
    return f" :{colour}[({text(by, 2, sign=True)})]"


def _figures(chosen: Sequence[Kept], kind: str, payloads: Sequence[float]) -> None:
    runs: list[tuple[str, Run]] = []
    for study in chosen:
        for payload in _few(payloads):
            row = _row(study, kind, payload)
            if row.run_id in study.result.runs:
                runs.append((study.name, study.result.runs[row.run_id]))
    if not runs:
        return
    # The strictest of the machines' limits: a line that holds for all of them.
    machines = [study.result.study.machine for study in chosen]
    strictest = min(machines, key=motor_torque_limit_nm)
    motor, limit = strictest.motor, motor_torque_limit_nm(strictest)
    chart(
        overview(runs, motor.nominal_torque_nm, limit, "", height=740),
        "compare over time",
        "Speed, tracking error, torque and wire tension of the kept studies over time",
    )
    chart(
        torque_speed_plane(
            runs, motor.nominal_torque_nm, limit, motor.nominal_speed_rad_s, strictest.drive.field_weakening, height=460
        ),
        "compare plane",
        "Torque over speed of one motor, of the kept studies",
    )


def _few(payloads: Sequence[float]) -> list[float]:
    """The lightest, a middle and the heaviest."""
    if len(payloads) <= MOST_COLUMNS:
        return list(payloads)
    return [payloads[0], payloads[len(payloads) // 2], payloads[-1]]
