"""The page Compare: kept runs side by side, their signals over one another and their metrics with differences.

keep(name, scenario, machine, result)   keeps a study's runs; returns the name they are listed under
kept()                                  name -> Kept, in the order they were kept
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import streamlit as st

from workbench.control import Cascade
from workbench.core.run import Run
from workbench.dashboard import session
from workbench.dashboard.pages.study_desk import scenario_file
from workbench.dashboard.widgets import SAME, chart, plain, text
from workbench.machines import Axis, Hoist, Kind, kind_of, studied
from workbench.metrics import Metric, View, shown_in
from workbench.study.rows import Row, metrics_of
from workbench.study.run import StudyResult, motor_torque_limit_nm, peak_limit
from workbench.study.scenario import Scenario
from workbench.view.study_figures import MOST_COLUMNS, axis_overview, overview, torque_speed_plane
from workbench.view.style import label

MOST_SAID = 3  # values by which a machine is told from another of its name


KEY = "runs kept"
MOST = 8  # more lines than that are a tangle


@dataclass(frozen=True)
class Kept:
    """A study's runs with what they were run from. machine: as chosen, before the scenario's overrides."""

    name: str
    scenario: Scenario
    machine: Hoist | Axis
    result: StudyResult


def kept() -> dict[str, Kept]:
    return session.get(KEY, dict, {})


def keep(name: str, scenario: Scenario, machine: Hoist | Axis, result: StudyResult) -> str:
    """Keeps the runs under the name, or under the name with a number where other runs have it."""
    known = kept()
    free, number = name, 2
    while free in known and (known[free].scenario, known[free].machine) != (scenario, machine):
        free, number = f"{name} ({number})", number + 1
    later = {**known, free: Kept(free, scenario, machine, result)}
    session.put(KEY, dict(list(later.items())[-MOST:]))
    return free


def is_kept(scenario: Scenario, machine: Hoist | Axis) -> bool:
    return any((study.scenario, study.machine) == (scenario, machine) for study in kept().values())


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
    others = [study.name for study in chosen if _kind(study).name != _kind(baseline).name]
    if others:
        st.info(f"Of another kind of machine than {plain(baseline.name)}, and left out: {plain(', '.join(others))}.")
    chosen = [study for study in chosen if study.name not in others]
    payloads = _payloads(chosen, kind)
    if not payloads:
        common = "payload in common for" if _kind(baseline).payload else "run in common of"
        st.info(f"These studies have no {common} this reference.")
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
                "Save", scenario_file(study.scenario, study.machine), file_name=f"{study.scenario.name}.yaml",
                mime="application/yaml", key=f"compare save {name}", on_click="ignore", width="stretch",
            )  # fmt: skip
            if removing.button("Remove", key=f"compare remove {name}", width="stretch"):
                session.put(KEY, {known: other for known, other in kept().items() if known != name})
                st.rerun()


def _kind(study: Kept) -> Kind:
    return kind_of(study.machine)


def _gains(study: Kept) -> list[tuple[str, float, str]]:
    """Each gain with its unit, as the machine ran with it."""
    loop = study.result.study.scenario.controller
    outer = [("kv", loop.kv_per_s, "1/s")] if isinstance(loop, Cascade) else []
    return [*outer, ("kp", loop.kp, loop.UNITS[0]), ("ki", loop.ki, loop.UNITS[1])]


def _settings(study: Kept) -> str:
    gains = ", ".join(f"{name} {value:.4g} {unit}" for name, value, unit in _gains(study))
    return f"{study.machine.name}: {', '.join(said for said in (limits_text(study), gains) if said)}"


def limits_text(study: Kept) -> str:
    """Speed, acceleration and jerk, in the unit of the machine's way."""
    limits, unit = study.scenario.limits.given(), kind_of(study.machine).moved.unit
    each = (("speed_m_s", "/s"), ("acceleration_m_s2", "/s²"), ("jerk_m_s3", "/s³"))
    return ", ".join(f"{limits[name]:g} {unit}{per}" for name, per in each if name in limits)


def _settings_rows(columns: Sequence[Kept]) -> list[tuple[str, list[str]]]:
    """The machine of each study, and limits, gains and model where they differ."""
    machines = [machine_told_apart(study, columns) for study in columns]
    rows = [("machine", machines)]
    for what, say in (
        ("limits", lambda study: limits_text(study)),
        (
            ", ".join(name for name, _, _ in _gains(columns[0])),
            lambda study: ", ".join(f"{value:.4g}" for _, value, _ in _gains(study)),
        ),
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


def values_of(machine: Hoist | Axis) -> dict[str, float]:
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
    for metric in shown_in(View.COMPARE, metrics_of(rows)):
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
    load = f", {payload:g} kg" if _kind(baseline).payload else ""
    st.caption(f"{label(kind).capitalize()}{load}. In brackets the difference to {plain(baseline.name)}.")


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
    hoists = [hoist for study in chosen if (hoist := studied(study.result.study.machine)) is not None]
    if hoists:
        _of_hoists(runs, hoists)
    else:
        _of_axes(runs, [cast(Axis, study.result.study.machine) for study in chosen])


def _of_axes(runs: Sequence[tuple[str, Run]], machines: Sequence[Axis]) -> None:
    strictest = min(machines, key=peak_limit)
    kind, limit = kind_of(strictest), peak_limit(strictest)
    alt = f"Position, tracking error, speed and {kind.drive.quantity} of the kept studies over time"
    chart(axis_overview(runs, kind, limit, strictest.drive.nominal, "", height=740), "compare over time", alt)


def _of_hoists(runs: Sequence[tuple[str, Run]], machines: Sequence[Hoist]) -> None:
    # The strictest of the machines' limits: a line that holds for all of them.
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
