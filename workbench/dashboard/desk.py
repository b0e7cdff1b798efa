"""The question of the page Study: a scenario for each kind of machine, its form, its files, its address.

The session keeps one scenario a kind; its controller is the one of all pages. `fields_of` declares the numbers that can
be set, with their keys in the scenario and their ranges on a machine: the form, the names in errors and the tests
follow from that declaration. What no control shows (events, effects, drive, …) stays as it was loaded.
"""

from __future__ import annotations

import base64
import math
import re
import zlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from typing import Any, cast

import streamlit as st

from workbench import machines
from workbench.analysis.usual import bandwidth_and_damping, rigid_gains, shaft_inertia_kg_m2, usual_cascade
from workbench.control import Cascade, PiSettings, Settings
from workbench.core.errors import InputError
from workbench.core.yaml_strict import dumps, load, loads, put
from workbench.dashboard import session
from workbench.dashboard.chosen import AXIS, DEFAULT, choose_machine, keep_machine
from workbench.dashboard.widgets import Field, fold, form, held, number, problem, text
from workbench.effects import check
from workbench.machines import Machine, default_hoist, kind_of, studied
from workbench.metrics import set_of
from workbench.references import BASELINE, Step, allowed_carriage_speed_m_s, planned_kinds
from workbench.study.decide import RESERVE, criteria_for
from workbench.study.load import changed, load_study, read_standalone, standalone_text
from workbench.study.scenario import CriterionBlock, LimitsBlock, MoveBlock, Scenario, key_in
from workbench.view.style import label

BANDWIDTH, GAINS = "bandwidth", "gains"
LIMITS = {"speed": "speed_m_s", "acceleration": "acceleration_m_s2", "jerk": "jerk_m_s3"}
ALIKE = 1.5  # times the inertia: another axis to which the same motion and gains still apply
LEAST_MOVE_M, ROOM_M = 0.5, 1.0  # of a hoist; room to move in, that the start leaves
MOST = 1e9
ADDRESS_KEY, PLACE, FILE, BETWEEN = "study", "the address", "machine.yaml", "\0"
LONGEST, MOST_BYTES = 6000, 100_000  # characters of the address; of the YAML in it
PAYLOADS = (0.0, 1500.0, 3000.0, 4500.0, 6000.0, 7500.0, 9000.0)
PLANTS = {"lumped": "lumped", "multibody": "multi-body"}
LOADED, NONE = "study file", "choose one"
DECIDE = "Decision: limits and weights"
THINNED = {"signals": "thinned", "every_s": 0.002}

# The page's first question, that of scenarios/payloads.yaml.
START = Scenario(
    name="what-if",
    payloads_kg=(0.0, 4500.0, 9000.0),
    start_position_m=4.0,
    moves=(MoveBlock(by_m=12.0), MoveBlock(dwell_s=3.0), MoveBlock(by_m=-12.0)),
    limits=LimitsBlock(speed_m_s=0.7, acceleration_m_s2=0.6, jerk_m_s3=0.8),
    references=("trapezoid", "ruckig", "ruckig_equal_time"),  # a linear program, "optimal", takes half a second more
    controller=PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0),
    settle_s=3.0,
)


@dataclass(frozen=True)
class Desk:
    """inertia: of the machine that it was set for, kg or kg m². loop: bandwidth (Hz) and damping of the rigid drive
    where a hoist's controller is set by these; its gains then follow the machine."""

    kind: str
    inertia: float
    scenario: Scenario
    loop: tuple[float, float] | None = None

    def suits(self, machine: Machine) -> bool:
        """Whether what is set for one machine is a sensible beginning for this one."""
        kind = kind_of(machine)
        ratio = kind.looped.total_inertia(machine, 0.0) / self.inertia
        return kind.name == self.kind and (bool(kind.payload) or 1.0 / ALIKE < ratio < ALIKE)


def desk_of(scenario: Scenario, machine: Machine, loop: tuple[float, float] | None = None) -> Desk:
    kind = kind_of(machine)
    return Desk(kind.name, kind.looped.total_inertia(machine, 0.0), opened(scenario, machine), loop)


def usual_desk(machine: Machine) -> Desk:
    """What the page begins with. Hoist: `START`, the loop by bandwidth.

    Axis: there and back at six tenths of the top speed, a third of the drive's limit for the ramps, the controller by
    rule; for a top speed that is nowhere stated a fifth of a metre or two radians a second serve.
    """
    kind = kind_of(machine)
    if kind.payload:
        loop = (2.5, 1.0)
        kp, ki = rigid_gains(shaft_inertia_kg_m2(cast(machines.Hoist, machine)), *loop)
        return desk_of(edited(START, machine, {"kp": kp, "ki": ki}), machine, loop)

    def short(value: float) -> float:
        return float(f"{value:.2g}")

    inertia, unit = kind.looped.total_inertia(machine, 0.0), kind.moved.unit
    speed = 0.6 * kind.looped.speed_scale(machine)
    ramp = max(0.2, 3.0 * speed * inertia / kind.looped.input_limit(machine))
    limits = (speed, speed / ramp, 1.5 * speed / ramp**2)
    usual = Scenario.model_validate({
        "name": START.name, key_in(unit, "start_position_m"): 0.0,
        "moves": _there_and_back(unit, short(3.0 * speed * ramp), 0.5),
        "limits": {key_in(unit, key): short(value) for key, value in zip(LIMITS.values(), limits, strict=True)},
        "references": (BASELINE, "ruckig", "ruckig_equal_time"),
        "controller": usual_cascade(cast(machines.Axis, machine)).model_dump(),
        "lead_s": 0.2, "settle_s": 0.8, "outputs": THINNED,
    })  # fmt: skip
    return desk_of(usual, machine)


def current(machine: Machine) -> Desk:
    """What this session has set for this kind of machine; its usual question before."""
    desk = st.session_state.get(_key(machine))
    return desk if isinstance(desk, Desk) and desk.suits(machine) else usual_desk(machine)


def _key(machine: Machine) -> str:
    return f"desk {kind_of(machine).name}"


def controller(machine: Machine) -> Settings:
    """The controller of all pages."""
    return current(machine).scenario.controller


def change(machine: Machine, values: Mapping[str, Any]) -> Settings:
    """Sets values of the controller of all pages, as `edited`; what it is then."""
    desk = current(machine)
    try:
        scenario = edited(desk.scenario, machine, values)
    except InputError as error:
        raise named(error, machine, replace(desk, loop=None)) from error
    if scenario.controller != desk.scenario.controller:
        session.put(_key(machine), replace(desk, scenario=scenario, loop=None))
    return scenario.controller


# ---- from and to a scenario ---------------------------------------------------------------------------------------


def there_and_back(moves: Sequence[MoveBlock]) -> tuple[float, float] | None:
    """Way (m or rad) and dwell (s) of moves that go one way, wait and come back; None for any others."""
    match [block.step() for block in moves]:
        case [Step(by_m=float() as way), Step(dwell_s=float() as dwell), Step(by_m=float() as back)] if way == -back:
            return way, dwell
    return None


def _there_and_back(unit: str, way: float, dwell_s: float) -> tuple[dict[str, float], ...]:
    by = key_in(unit, "by_m")
    return {by: way}, {"dwell_s": dwell_s}, {by: -way}


def opened(scenario: Scenario, machine: Machine) -> Scenario:
    """The scenario as the page shows it: the trapezoid first, limits both ways with a jerk, those of lowering apart
    where they are other ones, signals kept. InputError for one that the page cannot show: a sweep, a sample."""
    for key in ("sweep", "sample"):
        if getattr(scenario, key) is not None:
            raise InputError("is a batch of runs; run it on the page Batches, or take it out", place=key)
    kind, unit = kind_of(machine), kind_of(machine).moved.unit
    if not kind.payload and not isinstance(scenario.controller, Cascade):
        raise InputError(f"is a hoist's; {machines.of_kind(machine)} takes kind: cascade", place="controller")
    if scenario.start is None or not scenario.moves or (kind.payload and scenario.payloads_kg is None):
        raise InputError(f"expected {'payloads_kg, ' * bool(kind.payload)}{key_in(unit, 'start_position_m')} and moves")

    def limits(way: str) -> dict[str, float]:
        """Of one direction; where none is given the jerk is one and a half ramps' worth, of a hoist 0.8 m/s³."""
        given = scenario.limits.given() | getattr(scenario.limits, way).given()
        for name in ("speed", "acceleration"):
            if LIMITS[name] not in given:
                place = f"limits.{key_in(unit, LIMITS[name])}"
                raise InputError("is missing; expected a positive number", place=place)
        usual = float(f"{1.5 * given[LIMITS['acceleration']] ** 2 / given[LIMITS['speed']]:.2g}")
        return {key_in(unit, key): given.get(key, 0.8 if kind.payload else usual) for key in LIMITS.values()}

    up, down = limits("hoisting"), limits("lowering")
    signals = START.outputs if kind.payload else THINNED
    return changed(
        scenario,
        {
            "references": (BASELINE, *(name for name in scenario.planned_kinds if name != BASELINE)),
            "limits": up if up == down else {**up, "lowering": down},
            "outputs": signals if scenario.outputs.signals == "none" else scenario.outputs,
        },
    )


def fields_of(machine: Machine, scenario: Scenario, start: float | None = None) -> dict[str, Field]:
    """The numbers of this kind of machine, by name, with their ranges. start: of the move, for the way's range."""
    kind, settings = kind_of(machine), scenario.controller
    unit, ahead = kind.moved.unit, type(settings.feed_forward).model_fields
    at, (kp, ki) = (key_in(unit, "start_position_m"),), (("controller", name) for name in settings.GAINS)
    keys = {name: ("limits", key_in(unit, key)) for name, key in LIMITS.items()}
    fields = {"weight": Field("Set-point weight (–)", ("controller", "set_point_weight"), 0.0, 1.0, 0.05)}
    for name in ahead:
        called = "… that knows the wire (–)" if name == "wire" else f"Feed-forward of {name} (–)"
        fields[f"ff {name}"] = Field(called, ("controller", "feed_forward", name), 0.0, 1.0, 0.05)
    if (hoist := studied(machine)) is not None and kind.payload:
        low, high, motor = hoist.rail.lowest_position_m, hoist.highest_position_m, hoist.motor.nominal_speed_rad_s
        allowed = allowed_carriage_speed_m_s(motor, hoist.gearbox.ratio, hoist.winch.drum_diameter_m)
        fastest = max(int(allowed * 100.0) / 100.0, min(allowed, 0.1))  # rounded down to what the slider shows
        up = high - (scenario.start or 0.0 if start is None else start)
        fields |= {
            "start": Field("Start height (m)", at, low, high - ROOM_M, 0.5),
            "way": Field("Up and down by (m)", ("moves",), LEAST_MOVE_M, up, 0.5),
            "bandwidth": Field("Bandwidth (Hz)", kp, 0.5, 6.0, 0.1, most=500.0),
            "damping": Field("Damping (–)", ki, 0.4, 2.0, 0.05, tip="1 is ki = kp·ω/4."),
            "kp": Field("kp (N m s/rad)", kp, 2.0, 80.0, 0.5, "%.4g", most=1e6),
            "ki": Field("ki (N m/rad)", ki, 0.0, 600.0, 1.0, "%.4g", most=1e6),
        }
        hoisting = "hoisting " * bool(scenario.limits.lowering.given())
        ranges = {"speed": (fastest, 0.01, None, ""), "acceleration": (1.5, 0.05, 20.0, ""),
                  "jerk": (5.0, 0.1, 1e3, "The trapezoid has none.")}  # fmt: skip
        for before, way, block in (("", hoisting, ()), ("down ", "lowering ", ("lowering",))):
            for (name, (top, step, most, tip)), per in zip(ranges.items(), ("m/s", "m/s²", "m/s³"), strict=True):
                key = ("limits", *block, LIMITS[name])
                fields[before + name] = Field(f"Limit {way}{name} ({per})", key, 0.1, top, step, tip=tip, most=most)
        return fields

    def wide(words: str, key: tuple[str, ...], began: float, tip: str = "", most: float = MOST) -> Field:
        about = float(f"{began:.1g}") if began > 0.0 else 1.0  # a range of a few times what it began with
        return Field(words, key, 0.0, min(4.0 * about, most), about / 50.0, "%.4g", tip, most)

    usual, top = usual_desk(machine).scenario, kind.looped.top_speed(machine).speed
    rule, given = cast(Cascade, usual.controller), usual.limits.given()
    speed, acceleration, jerk = (given[key] for key in LIMITS.values())
    return fields | {
        "start": Field(f"Start position ({unit})", at, -1e6, 1e6, slides=False),
        "way": Field(f"There and back by ({unit})", ("moves",), -1e6, 1e6, slides=False),
        "dwell": Field("Rest (s)", ("moves",), 0.0, 600.0, slides=False),
        "speed": wide(f"Limit speed ({unit}/s)", keys["speed"], speed, most=top if math.isfinite(top) else MOST),
        "acceleration": wide(f"Limit acceleration ({unit}/s²)", keys["acceleration"], acceleration),
        "jerk": wide(f"Limit jerk ({unit}/s³)", keys["jerk"], jerk, "The trapezoid has none."),
        "kv": wide("kv (1/s)", ("controller", "kv_per_s"), rule.kv_per_s or 10.0, "0 is a speed loop alone."),
        "kp": wide(f"kp ({settings.UNITS[0]})", kp, rule.kp),
        "ki": wide(f"ki ({settings.UNITS[1]})", ki, rule.ki or rule.kp),
    }


def value_of(name: str, field: Field, scenario: Scenario) -> float:
    """What the scenario says of a field."""
    if field.key == ("moves",):
        way, dwell = there_and_back(scenario.moves) or (12.0, 3.0)
        return dwell if name == "dwell" else way
    value: Any = reduce(getattr, field.key, scenario)  # None: of lowering, as of hoisting
    return float(getattr(scenario.limits, field.key[-1]) if value is None else value)


def edited(scenario: Scenario, machine: Machine, values: Mapping[str, Any]) -> Scenario:
    """The scenario with other values: those of fields by their names, anything else by its dotted key. InputError for
    what does not fit, under the scenario's key."""
    data, fields = scenario.model_dump(), fields_of(machine, scenario)
    if {"way", "dwell"} & set(values):
        way, dwell = there_and_back(scenario.moves) or (12.0, 3.0)
        moves = kind_of(machine).moved.unit, values.get("way", way), values.get("dwell", dwell)
        values = {**values, "moves": _there_and_back(*moves)}
    for name, value in values.items():
        if name not in ("way", "dwell"):
            put(data, fields[name].key if name in fields else tuple(name.split(".")), value)
    return changed(scenario, data)


def named(error: InputError, machine: Machine, desk: Desk) -> InputError:
    """The error under the name of the control that set the value."""
    hidden = ("kp", "ki") if desk.loop else ("bandwidth", "damping")
    fields = fields_of(machine, desk.scenario)
    called = {field.key[-1]: field.words for name, field in reversed(fields.items()) if name not in hidden} | {
        "name": "Name of the study", "payloads_kg": "Payloads (kg)", "references": f"Against the {BASELINE}",
        "plant": "Model", "decide": DECIDE,
    }  # fmt: skip
    parts = re.findall(r"\w+", error.place or "")
    name = next((called[part] for part in reversed(parts) if part in called), error.place)
    return InputError(error.problem, file=error.file, line=error.line, place=name)


# ---- the form -----------------------------------------------------------------------------------------------------


def controls(machine: Machine, bad: list[InputError]) -> Desk:
    """Draws the controls in the side bar; what they stand at. What is set stays when another page is looked at
    meanwhile. bad: takes what was entered and cannot be used, under the names of the controls."""
    desk, kind = current(machine), kind_of(machine)
    scenario, values = desk.scenario, dict[str, Any]()
    above, below = st.container(), st.container()
    with below:  # first: a file that is chosen sets all that stands above
        values["name"] = _file(scenario.name, machine)
    with above:
        if kind.payload:
            values["payloads_kg"] = _payloads(scenario.payloads_kg or (), bad)
        others = {name: kind for name, kind in planned_kinds().items() if name != BASELINE}
        chosen = st.pills(
            f"Against the {BASELINE}", list(others), selection_mode="multi", format_func=label,
            key=held("study.references", [name for name in scenario.kinds if name != BASELINE]),
            help="\n".join(f"- {kind.label}: {kind.definition}" for kind in others.values()),
        )  # fmt: skip
        values["references"] = (BASELINE, *(name for name in others if name in chosen))
        with st.expander("Motion", expanded=True, icon=f":material/{'height' if kind.payload else 'swap_horiz'}:"):
            values |= _motion(scenario, machine)
        title = "Speed controller" if kind.payload else "Cascade: position over speed"
        with st.expander(title, expanded=True, icon=":material/tune:"):
            own, loop = _controller(desk, machine)
            values |= own
        if (part := fold("Set-point weight, feed-forward", "feed", "fast_forward")).open:
            fed = [name for name in fields_of(machine, scenario) if name == "weight" or name.startswith("ff ")]
            with part:
                values |= _draw(scenario, machine, fed)
        if (part := fold(DECIDE, "decision", "gavel")).open:
            with part:
                values["decide"] = _decide(scenario, machine)
        if kind.payload:
            values["plant"] = st.selectbox(
                "Model", list(PLANTS), key=held("study.plant", scenario.plant), format_func=PLANTS.__getitem__,
                help="The multi-body machine has rigid bodies, joints, rollers and wire; a run of it takes some "
                "seconds. The curves beside the study stay on the lumped model.",
            )  # fmt: skip
    desk = replace(desk, loop=loop)
    try:
        if re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}", values["name"]) is None:
            said = f"'{values['name']}', expected up to 64 letters, digits, '.', '_' or '-'"
            raise InputError(said, place="name")
        if not bad:
            desk = replace(desk, scenario=edited(scenario, machine, values))
    except InputError as error:
        bad.append(error)
    session.put(_key(machine), desk)
    bad[:] = [named(error, machine, desk) for error in bad]
    return desk


def _draw(scenario: Scenario, machine: Machine, names: Sequence[str], start: float | None = None) -> dict[str, float]:
    fields = fields_of(machine, scenario, start)
    return {name: number(fields[name], value_of(name, fields[name], scenario), f"study.{name}") for name in names}


def _motion(scenario: Scenario, machine: Machine) -> dict[str, Any]:
    values: dict[str, Any] = _draw(scenario, machine, ["start"])
    known, hoist = there_and_back(scenario.moves) is not None, bool(kind_of(machine).payload)
    if known or not st.toggle("Moves as in the file", key=held("study.own", True)):
        values |= _draw(scenario, machine, ["way"] if hoist else ["way", "dwell"], values["start"])
    values |= _draw(scenario, machine, list(LIMITS))
    down = [f"down {name}" for name in LIMITS] if hoist else []
    apart = bool(scenario.limits.lowering.given())
    if hoist and st.toggle("Lower under other limits", key=held("study.split", apart)):
        return values | _draw(scenario, machine, down)
    return values | dict.fromkeys(down)


def _controller(desk: Desk, machine: Machine) -> tuple[dict[str, float], tuple[float, float] | None]:
    """The fields' values; and bandwidth and damping where a hoist's controller is set by them."""
    scenario = desk.scenario
    if not kind_of(machine).payload:
        return _draw(scenario, machine, ["kv", "kp", "ki"]), None
    settings, inertia = scenario.controller, shaft_inertia_kg_m2(cast(machines.Hoist, machine))
    by = st.segmented_control(
        "Set by", (BANDWIDTH, GAINS), key=held("study.by", BANDWIDTH if desk.loop else GAINS),
        label_visibility="collapsed", required=True, width="stretch",
    )  # fmt: skip
    hz, damping = bandwidth_and_damping(inertia, settings.kp, settings.ki)
    if by == GAINS:
        values = _draw(scenario, machine, ["kp", "ki"])
        hz, damping = bandwidth_and_damping(inertia, values["kp"], values["ki"])
        st.caption(f"Bandwidth {text(hz, 2)} Hz, damping {text(damping, 2)}: empty gripper, rigid drive.")
        return dict(values), None
    hz, damping = desk.loop or (round(hz, 2), round(damping, 2) if math.isfinite(damping) else 1.0)
    fields = fields_of(machine, scenario)
    loop = number(fields["bandwidth"], hz, "study.bandwidth"), number(fields["damping"], damping, "study.damping")
    kp, ki = rigid_gains(inertia, *loop)
    st.caption(f"kp {text(kp)} N m s/rad, ki {text(ki)} N m/rad: empty gripper, rigid drive.")
    return {"kp": kp, "ki": ki}, loop


def _payloads(now: Sequence[float], bad: list[InputError]) -> tuple[float, ...]:
    def read(entries: Sequence[Any]) -> list[float]:
        """Nothing where one of them is no number."""
        with suppress(ValueError):
            return sorted({float(entry) for entry in entries})
        return []

    chosen: list[Any] = st.multiselect(
        "Payloads (kg)", sorted({*PAYLOADS, *now}), accept_new_options=True,
        key=held("study.payloads", list(now), None, read), help="Type any other payload and press Enter.",
        format_func=lambda kg: kg if isinstance(kg, str) else f"{kg:g}",
    )  # fmt: skip
    if not chosen:
        bad.append(InputError("choose at least one payload", place="payloads_kg"))
    for wrong in [entry for entry in chosen if not read([entry])][:1]:
        bad.append(InputError(f"'{wrong}', expected a number in kg", place="payloads_kg"))
    return tuple(read(chosen))


def _decide(scenario: Scenario, machine: Machine) -> dict[str, dict[str, float]]:
    """Limit and weight of each criterion; an empty field leaves the usual one, which stands in it in grey."""
    judged = set_of(kind_of(machine).name)
    usual = criteria_for(judged, machine, max(scenario.payloads_kg or (0.0,)), {})
    st.caption("Who breaks a limit is out; of the rest the least weighted sum of shares is taken.")
    decide: dict[str, dict[str, float]] = {}
    for criterion in usual:
        metric, name, title = criterion.metric, criterion.name, criterion.metric.heading
        side, scale, unit = "least" if metric.better == "higher" else "most", metric.scale, metric.shown_unit or "–"
        known = getattr(criterion, side)
        if name == judged.peak and criterion.most is not None:  # said as what the peak leaves
            name, title, side, known, scale, unit = RESERVE, "Reserve at the peak", "least", 10.0, 1.0, "%"
        given = scenario.decide.get(name, CriterionBlock())
        limit = getattr(given, side)
        left, right = st.columns([2.0, 1.0], vertical_alignment="bottom")
        limit = left.number_input(
            f"{title}, at {side} ({unit})", value=None, step=None, format="%.4g",
            key=held(f"study.limit {name}", None if limit is None else scale * limit),
            placeholder="no limit" if known is None else f"{scale * known:.4g}",
        )  # fmt: skip
        weight = right.number_input(
            "weight", 0.0, 100.0, value=None, step=None, key=held(f"study.weight {name}", given.weight),
            placeholder=f"{criterion.weight:g}", format="%.3g",
        )  # fmt: skip
        block = {"weight": weight, side: None if limit is None else limit / scale}
        decide[name] = {key: value for key, value in block.items() if value is not None}
    others = {key: block.model_dump() for key, block in scenario.decide.items() if key not in decide}
    return others | {name: block for name, block in decide.items() if block}


def _file(name: str, machine: Machine) -> str:
    """The study's name. A scenario file that is chosen anew sets the controls; one that cannot be read leaves them."""
    if not (part := fold("Scenario file", "scenario", "description")).open:
        return name
    with part:
        name = st.text_input("Name of the study", key=held("study.name", name), max_chars=64)
        ships = st.selectbox("One that ships", [NONE, *shipped_scenarios()], key="study ships")
        upload = st.file_uploader("Load a scenario", type=["yaml", "yml"], key="study upload", max_upload_size=1)
        asked = (ships, upload.file_id if upload is not None else "")
        before, error = session.get(LOADED, tuple, ((NONE, ""), None))
        if asked != before:  # chosen anew: one of both
            error = None
            try:
                if upload is not None and asked[1] != before[1]:
                    own, known = None if machine == default_hoist() else machine, shipped_scenarios().values()
                    document = load(session.stored(upload, "scenario.yaml"))
                    scenario = read_standalone(document, own, {file.name: file for file in known})
                    set_desk(desk_of(scenario, machine), machine)
                elif ships not in (NONE, before[0]):
                    set_desk(*shipped_desk(ships, machine))
            except InputError as refused:
                error = refused
            session.put(LOADED, (asked, error))
            if error is None:
                st.rerun()  # the name stands above and is drawn already
        if error is not None:
            problem(error)
    return name


def set_desk(desk: Desk, machine: Machine) -> None:
    """The controls stand so from the next run of the page on, on this machine."""
    if machine in (default_hoist(), machines.shipped("emps_axis")):
        choose_machine(DEFAULT if machine == default_hoist() else AXIS)
    elif not kind_of(machine).payload:
        choose_machine(keep_machine(machine.name, machine))
    session.put(_key(machine), desk)


def machine_form(machine: Machine, key: str) -> Machine:
    """The machine with the values that are set in fields, which follow from its record. InputError for what cannot
    be."""
    data = form(type(machine), machine.model_dump(mode="json"), key)
    return machines.machine_from(
        loads(dumps({k: v for k, v in data.items() if v is not None}), FILE), check_effects=check
    )


# ---- files and the address ----------------------------------------------------------------------------------------


def shipped_scenarios() -> dict[str, Path]:
    """The scenarios that come with the program, or lie in the folder where it was started, by name."""
    for folder in (Path(__file__).resolve().parents[2] / "scenarios", Path.cwd() / "scenarios"):
        if files := {file.stem: file for file in sorted(folder.glob("*.yaml"))}:
            return files
    return {}


def shipped_as(machine: Machine) -> str | None:
    """What a scenario calls the machine; None for one that does not ship."""
    return next((name for name in machines.SHIPPED if machines.shipped(name) == machine), None)


def scenario_file(scenario: Scenario, machine: Machine, file: str = "") -> str:
    """The scenario as YAML. A hoist's own values are in it; an axis is named, by `file` where it does not ship."""
    if kind_of(machine).payload:
        return standalone_text(scenario, machine)
    return standalone_text(scenario, machine, shipped_as(machine) or file or f"{scenario.name}_machine.yaml")


def files_of(scenario: Scenario, machine: Machine) -> list[tuple[str, str, str]]:
    """Button, file name, text: the scenario, and the axis that it names where that does not ship."""
    files = [("Save scenario", f"{scenario.name}.yaml", scenario_file(scenario, machine))]
    if not kind_of(machine).payload and not shipped_as(machine):
        files.append(("Save machine", f"{scenario.name}_machine.yaml", machines.machine_text(machine)))
    return files


def shipped_desk(name: str, machine: Machine) -> tuple[Desk, Machine]:
    """What a shipped scenario asks, on its own machine where it names one, at its base values where it sweeps or draws
    some; and the machine to go over to. InputError for one that no control shows."""
    study = load_study(shipped_scenarios()[name])
    scenario, own, hoist = study.scenario, studied(study.machine), studied(machine)
    if own is None:
        axis = machines.shipped(scenario.machine) if scenario.machine in machines.SHIPPED else None
        if axis is None or studied(axis) is not None:
            raise InputError(f"is a study of {machines.of_kind(study.machine)} in a file of its own; run it as a batch")
        return desk_of(changed(scenario, {"sweep": None, "sample": None}), axis), axis
    if scenario.machine != "default":  # its values as overrides: the page's machine is another choice
        scenario = read_standalone(loads(standalone_text(scenario, own), f"{name}.yaml"))
    payloads = scenario.payloads_kg or START.payloads_kg  # those of a sweep go with it
    scenario = changed(scenario, {"sweep": None, "sample": None, "payloads_kg": payloads})
    return desk_of(scenario, hoist or default_hoist()), hoist or default_hoist()


def in_address(scenario: Scenario, machine: Machine) -> str | None:
    """What the address holds, compressed: the scenario, and behind it an axis that does not ship. None for the study
    that the page begins with, and for one too long for an address."""
    text_ = scenario_file(scenario, machine, FILE)
    if kind_of(machine).payload:
        if machine == default_hoist() and scenario == usual_desk(machine).scenario:
            return None
    elif not shipped_as(machine):
        text_ += BETWEEN + machines.machine_text(machine)
    packed = base64.urlsafe_b64encode(zlib.compress(text_.encode(), 9)).decode().rstrip("=")
    return packed if len(packed) <= LONGEST else None


def from_address(packed: str) -> tuple[Desk, Machine]:
    """What a link asks and the machine that it is of; a hoist's own values are in its scenario.

    InputError for an address that was cut or changed.
    """
    wrong = InputError("is damaged; the address has to be copied whole", place=ADDRESS_KEY)
    try:
        unpacking = zlib.decompressobj()
        raw = base64.urlsafe_b64decode(packed + "=" * (-len(packed) % 4))
        plain = unpacking.decompress(raw, MOST_BYTES).decode()
    except (zlib.error, ValueError) as error:
        raise wrong from error
    if not unpacking.eof:
        raise wrong
    scenario, _, machine_yaml = plain.partition(BETWEEN)
    machine = machines.machine_from(loads(machine_yaml, PLACE), check_effects=check) if machine_yaml else None
    axis = None if machine is None or studied(machine) is not None else machine
    read = read_standalone(loads(scenario, PLACE), axis)
    own = axis or machines.shipped(read.machine)
    if machines.looped(own) is None:
        raise InputError(f"is of {machines.of_kind(own)}; expected {machines.LOOPED}", place=ADDRESS_KEY)
    own = default_hoist() if studied(own) is not None else own
    return desk_of(read, own), own
