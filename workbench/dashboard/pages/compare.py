"""The page Compare: kept studies side by side, their signals over one another and their metrics with differences.

keep(name, scenario, machine, result)   keeps a study's runs; returns the name they are listed under
kept()                                  name -> Kept, in the order they were kept
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import streamlit as st

from workbench.dashboard import desk, session, widgets
from workbench.dashboard.chosen import free_name
from workbench.dashboard.widgets import SAME, by_words, guarded, held, plain, text
from workbench.machines import Machine, get_value, kind_of, value_names
from workbench.metrics import Metric, View, shown_in
from workbench.study.load import plan_study
from workbench.study.rows import Row, metrics_of
from workbench.study.run import StudyResult, peak_limit, run_study
from workbench.study.scenario import Scenario
from workbench.view.study import over_time, plane
from workbench.view.study_figures import few
from workbench.view.style import label

KEY = "runs kept"
MOST = 8  # more lines than that are a tangle
MOST_SAID = 3  # values by which a machine is told from another of its name


@dataclass(frozen=True)
class Kept:
    """A study's runs with what they were run from. machine: as chosen, before the scenario's overrides."""

    name: str
    scenario: Scenario
    machine: Machine
    result: StudyResult

    @property
    def limits(self) -> str:
        """Speed, acceleration and jerk, in the unit of the machine's way."""
        given, unit = self.scenario.limits.given(), kind_of(self.machine).moved.unit
        each = zip(desk.LIMITS.values(), ("/s", "/s²", "/s³"), strict=True)
        return ", ".join(f"{given[name]:g} {unit}{per}" for name, per in each if name in given)

    @property
    def gains(self) -> dict[str, float]:
        """Name with unit -> value, as the machine ran with it."""
        loop = self.result.study.scenario.controller
        outer = {"kv (1/s)": loop.kv_per_s} if loop.kv_per_s is not None else {}
        return {**outer, f"kp ({loop.UNITS[0]})": loop.kp, f"ki ({loop.UNITS[1]})": loop.ki}

    def row(self, kind: str, payload_kg: float) -> Row:
        return next(r for r in self.result.rows if r.ok and (r.reference, r.payload_kg) == (kind, payload_kg))


def kept() -> dict[str, Kept]:
    return session.get(KEY, dict, {})


def keep(name: str, scenario: Scenario, machine: Machine, result: StudyResult) -> str:
    """Keeps the runs under the name, or under the name with a number where other runs have it."""
    known = kept()
    free = free_name(name, [n for n, o in known.items() if (o.scenario, o.machine) != (scenario, machine)])
    later = {**known, free: Kept(free, scenario, machine, result)}
    session.put(KEY, dict(list(later.items())[-MOST:]))
    return free


def show() -> None:
    """Draws the page."""
    runs = kept()
    if not runs:
        st.info("Nothing is kept yet. On the page Study, set something up and press **Keep for Compare**.")
        return
    with st.sidebar:
        names = st.multiselect("Side by side", list(runs), default=list(runs), key="compare names")
        first = names or list(runs)
        baseline = runs[st.selectbox("Differences to", first, key="compare baseline")]
        common = list(dict.fromkeys(kind for name in first for kind in runs[name].result.study.scenario.kinds))
        usual = common.index("ruckig") if "ruckig" in common else 0
        kind = st.radio("Reference", common, index=usual, format_func=label, key="compare reference")
        same = st.toggle("All under the same gains", key="compare same gains",
                         help=f"Runs the others again under kp, ki, kv, a gain schedule and the set-point weight of "
                         f"{plain(baseline.name)}; what else their controllers have stays.")  # fmt: skip
    _list(runs)
    if not names:
        st.info("Choose at least one of the kept studies.")
        return
    alike = kind_of(baseline.machine)
    others = [name for name in names if kind_of(runs[name].machine).name != alike.name]
    if others:
        st.info(f"Of another kind of machine than {plain(baseline.name)}, and left out: {plain(', '.join(others))}.")
    chosen = [runs[name] for name in names if name not in others]
    if same:
        with guarded():
            chosen = [study if study is baseline else under_gains(study, baseline) for study in chosen]
    offered = [{row.payload_kg for row in one.result.rows if row.ok and row.reference == kind} for one in chosen]
    payloads = sorted(set.intersection(*offered))
    if not payloads:
        st.info(f"These studies have no {'payload' if alike.payload else 'run'} in common for this reference.")
        return
    _table(chosen, baseline, kind, payloads, same)
    # The lightest, a middle and the heaviest; against the strictest of the machines' limits, which holds for all.
    rows = [(study, study.row(kind, payload)) for study in chosen for payload in few(payloads)]
    drawn = [(study.name, study.result.runs[row.run_id]) for study, row in rows if row.run_id in study.result.runs]
    if drawn:
        strictest = min((study.result.study.machine for study in chosen), key=peak_limit)
        figure = over_time(drawn, strictest, height=740)
        widgets.chart(figure, "compare over time", "The kept studies' signals over time")
        if alike.payload:
            figure = plane(drawn, strictest, 460)
            widgets.chart(figure, "compare plane", "Torque over speed of one motor, of the kept studies")


def under_gains(study: Kept, other: Kept) -> Kept:
    """The study, run again under another one's gains. InputError where they cannot be."""
    loop = other.result.study.scenario.controller
    gains = loop.model_dump(include={*loop.GAINS, "kv_per_s", "gain_schedule", "set_point_weight"})
    asked = {f"controller.{name}": value for name, value in gains.items()}
    scenario = desk.opened(desk.edited(study.scenario, study.machine, asked), study.machine)
    return replace(study, scenario=scenario, result=run_study(plan_study(scenario, study.machine)))


def _list(runs: Mapping[str, Kept]) -> None:
    """Each kept study with its settings, to save or to remove."""
    with st.expander(f"{len(runs)} kept", expanded=False, icon=":material/inventory_2:"):
        for name, study in runs.items():
            words, saving, removing = st.columns([6, 1.2, 1.2], vertical_alignment="center")
            gains = (f"{name} {value:.4g}" for name, value in study.gains.items())
            said = f"{study.machine.name}: {', '.join([study.limits, *gains])}"
            words.markdown(f"**{plain(name)}** · {plain(said)}")
            file = desk.scenario_file(study.scenario, study.machine), f"{study.scenario.name}.yaml", "application/yaml"
            with saving:
                widgets.downloads(f"compare {name}", [("Save", *file)], "stretch")
            if removing.button("Remove", key=f"compare remove {name}", width="stretch"):
                session.put(KEY, {known: other for known, other in kept().items() if known != name})
                st.rerun()


def machine_told_apart(study: Kept, columns: Sequence[Kept]) -> str:
    """The machine's name; of machines of one name, what is other than in the first."""
    own, first = study.result.study.machine, columns[0].result.study.machine
    if own == first or own.name != first.name:
        return own.name
    mine, others = ({name: get_value(machine, name) for name in value_names(machine)} for machine in (own, first))
    names = [name for name, value in mine.items() if others.get(name) != value and not name.startswith("effects.")]
    other = [f"{name.replace('_', ' ')} {mine[name]:.4g}" for name in names[:MOST_SAID]]
    effects = [name for name in own.effects if own.effects[name] != first.effects.get(name)][:MOST_SAID]
    return f"{own.name}: {', '.join([*other, *effects]) or 'without effects of the first'}"


def _table(chosen: Sequence[Kept], baseline: Kept, kind: str, payloads: Sequence[float], same: bool) -> None:
    payload = payloads[-1]
    if len(payloads) > 1:
        payload = st.segmented_control(
            "Payload", payloads, key=held("compare payload", payload, payloads), format_func=lambda kg: f"{kg:g} kg",
            required=True,
        ) or payload  # fmt: skip
    columns = [baseline, *(study for study in chosen if study.name != baseline.name)]
    lines = [["machine", *(plain(machine_told_apart(study, columns)) for study in columns)]]
    for what, told in (
        ("limits", [study.limits for study in columns]),
        (", ".join(baseline.gains), [", ".join(f"{value:.4g}" for value in study.gains.values()) for study in columns]),
        ("model", [study.scenario.plant for study in columns]),
    ):
        if len(set(told)) > 1:
            lines.append([what, *map(plain, told)])
    rows = [study.row(kind, payload) for study in columns]
    for metric in shown_in(View.COMPARE, metrics_of(rows)):
        if all(row.metrics.get(metric.name) is not None for row in rows):
            first, *others = (metric.scale * row[metric.name] for row in rows)
            unit = f" ({metric.shown_unit})" if metric.shown_unit else ""
            compared = (text(value) + difference(value, first, metric) for value in others)
            lines.append([plain(f"{metric.title}{unit}"), text(first), *compared])
    heads = ["", *(plain(study.name) for study in columns)]
    st.table({head: [line[k] for line in lines] for k, head in enumerate(heads)}, hide_index=True)
    load = f", {payload:g} kg" if kind_of(baseline.machine).payload else ""
    gains = f"All under the gains of {plain(baseline.name)}. " if same else ""
    st.caption(f"{label(kind).capitalize()}{load}. {gains}In brackets the difference to {plain(baseline.name)}.")


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
    return f" :{colour}[({by_words(by, '%' if metric.shown_unit == '%' else '')})]"
