"""The page Sizing: the smallest drive for the duty cycle that stands on Study, by the code of `workbench size`."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import streamlit as st

from workbench.core.yaml_strict import dumps, loads, validate
from workbench.dashboard import desk, jobs, session, widgets
from workbench.dashboard.chosen import hoist_of_session
from workbench.dashboard.jobs import INPUTS, VIEW, Teller
from workbench.dashboard.widgets import form, guarded, held, plain
from workbench.machines import Hoist
from workbench.study.size import CATALOGUE, MotorBlock, SizeFile, size
from workbench.view import size as view
from workbench.view.page import Section
from workbench.view.style import label

KIND, SIZE, SCENARIO, OWN = "size", "size.yaml", "scenario.yaml", "motors.csv"
BLOCKS = ("thermal", "inverter", "brake", "emergency", "resistor", "gearbox", "wire")
COUNTS, RATIOS = (1, 2, 3, 4), {"the machine's": (), "all of a series": "all"}


def show() -> None:
    """Draws the page."""
    with st.sidebar, guarded():
        machine = hoist_of_session("sizing machine")
        with st.expander("Its values: drum, gearbox, motor, wire", icon=":material/edit_note:"):
            machine = cast(Hoist, desk.machine_form(machine, f"sizing {machine.name}"))
        asked = _asked(machine)
        text = dumps(asked)
        validate(SizeFile, loads(text, SIZE))
        wanted = st.button("Size the drive", type="primary", width="stretch", icon=":material/play_arrow:",
                           key="sizing start")  # fmt: skip
        widgets.downloads("sizing", [(SIZE, text, SIZE, "application/yaml")], "stretch")
    scenario = desk.current(machine).scenario
    st.markdown(f"#### Sizing · {plain(machine.name)}")
    st.caption(plain(f"The duty cycle is the move of Study, {scenario.name}, under {label(asked['reference'])}, and a "
                     "rest. Every motor, count and ratio runs it in the same closed loop."))  # fmt: skip
    if wanted:
        inputs: dict[str, str | Path] = {SIZE: text, SCENARIO: desk.scenario_file(scenario, machine)}
        if asked["motors"] == OWN:
            inputs[OWN] = session.workspace() / OWN
        with guarded(stop=False):
            arguments = {"file": f"{INPUTS}/{SIZE}"}
            jobs.start(KIND, f"{__name__}:work", arguments, session.new_work_folder(), scenario.name, inputs)
    own = session.own_jobs(KIND)[:1]
    if not own:
        st.info("Nothing is sized yet.", icon=":material/straighten:")
    elif jobs.poll(own[0]).state == "done":
        with guarded():
            section = jobs.read_view(Section, own[0])
            widgets.points(section.sentences)
            for shown in section.tables:
                widgets.table(shown, in_words=True)
    else:
        jobs.cards(own)


def _asked(machine: Hoist) -> dict[str, Any]:
    """What the fields ask, as the file has it."""
    scenario = desk.current(machine).scenario
    kinds = [kind for kind in scenario.kinds if isinstance(kind, str)]
    usual = "ruckig" if "ruckig" in kinds else kinds[-1]
    reference = st.selectbox("Reference", kinds, key=held("sizing reference", usual, kinds), format_func=label)
    shares = {}
    with st.expander("Payloads and their share of the cycles", icon=":material/weight:"):
        for payload in scenario.payloads_kg or ():
            key = held(f"sizing share {payload:g}", 1.0)
            shares[payload] = st.number_input(f"{payload:g} kg (weight)", 0.0, 1e3, step=None, key=key)
        rest = st.number_input("Rest after each cycle (s)", 0.0, 1e4, step=None, key=held("sizing rest", 0.0))
    counts = st.multiselect("Motors", COUNTS, key=held("sizing counts", [machine.motor.count]))
    ratios = st.segmented_control("Gear ratios", list(RATIOS), key=held("sizing ratios", "all of a series"),
                                  required=True)  # fmt: skip
    upload = st.file_uploader("A catalogue of your own (CSV)", type=["csv"], key="sizing catalogue", max_upload_size=1)
    if upload is not None:
        session.stored(upload, OWN)
    widgets.downloads("sizing", [("The catalogue that ships", CATALOGUE.read_bytes(), OWN, "text/csv")], "stretch")
    asked: dict[str, Any] = {
        "format": 1, "name": scenario.name, "scenario": SCENARIO, "reference": reference, "rest_s": rest,
        "motors": "catalogue" if upload is None else OWN, "count": counts, "ratios": RATIOS[str(ratios)],
    }  # fmt: skip
    if len(shares) > 1:
        whole = sum(shares.values()) or 1.0
        asked["payloads"] = [{"payload_kg": kg, "share": share / whole} for kg, share in shares.items() if share]
    usual_file = SizeFile(name="x", scenario=SCENARIO).model_dump()
    blocks = form(SizeFile, {name: usual_file[name] for name in BLOCKS}, "sizing")
    if st.toggle("A motor of my own", key=held("sizing own", False)):
        blocks["motor"] = form(MotorBlock, MotorBlock(power_kw=45.0, speed_rpm=1480.0).model_dump(), "sizing motor")
    given = {name: {k: v for k, v in block.items() if v not in (None, "")} for name, block in blocks.items()}
    return asked | given


def work(out: Path, tell: Teller, file: str) -> None:
    """In the worker: sizes the drive that the file asks for. InputError for a file that cannot be read."""
    tell("every drive runs the cycle")
    sizing = size(file)
    tables = [view.candidates_table(sizing)]
    if sizing.taken is not None:
        tables += [view.checks_table(sizing.taken), view.s1_table(sizing)]
    out.mkdir()
    jobs.write_view(Section(sentences=view.sentences(sizing), tables=tables), out.parent / VIEW)
