"""The page Sizing: the smallest drive for the duty cycle that stands on Study, by the code of `workbench size`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import streamlit as st

from workbench.core.errors import InputError
from workbench.core.yaml_strict import dumps, loads, validate
from workbench.dashboard import session
from workbench.dashboard.chosen import hoist_of_session
from workbench.dashboard.desk import current, scenario_file
from workbench.dashboard.jobs import INPUTS, VIEW, Teller, cards, jobs_of, poll, read_view, start, write_view
from workbench.dashboard.widgets import form, guarded, held, plain, points, problem, table
from workbench.machines import Hoist
from workbench.study.size import CATALOGUE, MotorBlock, SizeFile, size
from workbench.view.page import Section
from workbench.view.size import candidates_table, checks_table, s1_table, sentences
from workbench.view.style import label

KIND, SIZE, SCENARIO, OWN = "size", "size.yaml", "scenario.yaml", "motors.csv"
BLOCKS = ("thermal", "inverter", "brake", "emergency", "resistor", "gearbox", "wire")
COUNTS, RATIOS = (1, 2, 3, 4), {"the machine's": (), "all of a series": "all"}


def show() -> None:
    """Draws the page."""
    with st.sidebar, guarded():
        machine = hoist_of_session("sizing machine")
        asked = _asked(machine)
        text = dumps(asked)
        validate(SizeFile, loads(text, SIZE))
        wanted = st.button("Size the drive", type="primary", width="stretch", icon=":material/play_arrow:",
                           key="sizing start")  # fmt: skip
        st.download_button(SIZE, text, SIZE, "application/yaml", width="stretch", icon=":material/download:",
                           on_click="ignore", key="sizing file")  # fmt: skip
    scenario = current(machine).scenario
    st.markdown(f"#### Sizing · {plain(machine.name)}")
    st.caption(plain(f"The duty cycle is the move of Study, {scenario.name}, under {label(asked['reference'])}, and a "
                     "rest. Every motor, count and ratio runs it in the same closed loop."))  # fmt: skip
    if wanted:
        inputs = {SIZE: text, SCENARIO: scenario_file(scenario, machine)}
        if asked["motors"] == OWN:
            inputs[OWN] = (session.workspace() / OWN).read_text("utf-8")
        try:
            _begin(inputs, scenario.name)
        except InputError as error:
            problem(error)
    jobs = jobs_of(session.work_folder(), KIND)[:1]
    if not jobs:
        st.info("Nothing is sized yet.", icon=":material/straighten:")
    elif poll(jobs[0]).state == "done":
        with guarded():
            section = read_view(Section, jobs[0])
            points(section.sentences)
            for shown in section.tables:
                table(shown)
    else:
        cards(jobs)


def _asked(machine: Hoist) -> dict[str, Any]:
    """What the fields ask, as the file has it. InputError for a catalogue that cannot be read."""
    scenario = current(machine).scenario
    kinds = [kind for kind in scenario.kinds if isinstance(kind, str)]
    reference = st.selectbox(
        "Reference",
        kinds,
        key=held("sizing reference", "ruckig" if "ruckig" in kinds else kinds[-1], kinds),
        format_func=label,
    )
    loads_, shares = scenario.payloads_kg or (), []
    with st.expander("Payloads and their share of the cycles", icon=":material/weight:"):
        for payload in loads_:
            share = st.number_input(f"{payload:g} kg (weight)", 0.0, 1e3, step=None,
                                    key=held(f"sizing share {payload:g}", 1.0))  # fmt: skip
            shares.append(share)
        rest = st.number_input("Rest after each cycle (s)", 0.0, 1e4, step=None, key=held("sizing rest", 0.0))
    whole = sum(shares) or 1.0
    counts = st.multiselect("Motors", COUNTS, key=held("sizing counts", [machine.motor.count]))
    ratios = st.segmented_control("Gear ratios", list(RATIOS), key=held("sizing ratios", "all of a series"),
                                  required=True)  # fmt: skip
    upload = st.file_uploader("A catalogue of your own (CSV)", type=["csv"], key="sizing catalogue", max_upload_size=1)
    if upload is not None:
        session.stored(upload, OWN)
    st.download_button("The catalogue that ships", CATALOGUE.read_bytes(), OWN, "text/csv", on_click="ignore",
                       key="sizing ships", width="stretch")  # fmt: skip
    motors = OWN if upload is not None else "catalogue"
    asked: dict[str, Any] = {
        "format": 1, "name": scenario.name, "scenario": SCENARIO, "reference": reference, "rest_s": rest,
        "motors": motors, "count": counts, "ratios": RATIOS[str(ratios)],
    }  # fmt: skip
    if len(loads_) > 1:
        pairs = zip(loads_, shares, strict=True)
        asked["payloads"] = [{"payload_kg": load, "share": share / whole} for load, share in pairs if share > 0.0]
    usual = SizeFile(name="x", scenario=SCENARIO).model_dump()
    blocks = form(SizeFile, {name: usual[name] for name in BLOCKS}, "sizing")
    if st.toggle("A motor of my own", key=held("sizing own", False)):
        own = MotorBlock(power_kw=45.0, speed_rpm=1480.0).model_dump()
        asked["motor"] = _given(form(MotorBlock, own, "sizing motor"))
    return asked | {name: _given(block) for name, block in blocks.items()}


def _given(block: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in block.items() if value not in (None, "")}


def _begin(inputs: dict[str, str], name: str) -> None:
    files = {}
    for file, text in inputs.items():
        files[file] = session.workspace() / f"sent {file}"
        files[file].write_text(text, encoding="utf-8")
    start(KIND, f"{__name__}:work", {"file": f"{INPUTS}/{SIZE}"}, session.new_work_folder(), name, files)


def work(out: Path, tell: Teller, file: str) -> None:
    """In the worker: sizes the drive that the file asks for. InputError for a file that cannot be read."""
    tell("every drive runs the cycle")
    sizing = size(file)
    taken = sizing.taken
    tables = [candidates_table(sizing), *([checks_table(taken), s1_table(sizing)] if taken is not None else [])]
    out.mkdir()
    write_view(Section(sentences=sentences(sizing), tables=tables), out.parent / VIEW)
