"""The page Import: logs as a drive or a PLC writes them, made a campaign step by step, by the code of `import`."""

from __future__ import annotations

import io
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import streamlit as st
from streamlit.runtime.uploaded_file_manager import UploadedFile

from workbench.core.errors import InputError
from workbench.core.names import unit_of, words_of
from workbench.dashboard import session
from workbench.dashboard.chosen import arrived, last_campaign, session_machine
from workbench.dashboard.desk import machine_form
from workbench.dashboard.uploads import MB, Uploaded, base_name, safe_name
from workbench.dashboard.widgets import chart, downloads, guarded, held, notes, plain, table
from workbench.logs import importing
from workbench.logs.formats.opening import suffixes
from workbench.machines import Machine, kind_of, machine_text, save_machine
from workbench.view.logs import drawn, mapping_table

TYPES = sorted({suffix.removeprefix(".") for suffix in (*importing.TEXT, *suffixes())})
MOST = 64 * MB
READ, MADE = "import read", "import made"
NONE, AS_WRITTEN = "–", "as the file says, else SI"


def show() -> None:
    """Draws the page."""
    with st.sidebar, guarded():
        machine = session_machine("import machine")
        with st.expander("Its values, machine.yaml", icon=":material/edit_note:"):
            machine = machine_form(machine, f"import {machine.name}")
        own = ("machine.yaml", machine_text(machine), "machine.yaml", "application/yaml")
        downloads("import", [own], "stretch")
    st.markdown("#### Logs as drives and PLCs write them, made a campaign")
    files = st.file_uploader("One file a run", type=TYPES, accept_multiple_files=True, key="import files")
    if not files:
        st.info("CSV or text, MAT, MDF4, TDMS, Parquet. The page proposes which column is what, and in which unit; you "
                "see each signal before anything is made.", icon=":material/upload:")  # fmt: skip
        return
    with guarded():
        logs = _runs(_read(files), machine)
        proposed = _mapping(machine, logs)
        table(replace(mapping_table(proposed), note=""), in_words=True)  # units are named in the fold above
        names = [log.name for log in logs]
        shown = logs[names.index(st.selectbox("Drawn", names, key=held("import drawn", names[0], names)))]
        signals = [(p.signal, p.column, *importing.in_si(p, shown)) for p in proposed.proposals]
        chart(drawn(signals), "import signals", "Each signal that is proposed, in SI, over time")
        st.caption("In SI, at its own samples; up, hoisting and forward are positive. Columns that are no signal: "
                   + plain(", ".join(proposed.unused) or "none") + ".")  # fmt: skip
        with st.expander("runs.yaml"):
            st.code(importing.runs_yaml(logs, proposed), language="yaml")
        _make(machine, logs, proposed)


def _read(files: Sequence[UploadedFile]) -> list[importing.Imported]:
    """The files' channels, read once. InputError names the file as it was uploaded."""
    known, logs = session.get(READ, dict, {}), dict[str, importing.Imported]()
    for file in files:
        if (log := known.get(file.file_id)) is None:
            name = Path(base_name(file.name))
            if (suffix := name.suffix.lower()).removeprefix(".") not in TYPES:
                raise InputError(f"expected a file that ends in {', '.join(TYPES)}", file=name.name)
            path = session.stored(file, f"{safe_name(name.stem) or 'run'}{suffix}", MOST)
            with st.spinner(f"Reading {plain(name.name)}"):
                log = importing.Imported(path, tuple(importing.read_channels(path)))
            path.unlink()
        logs[file.file_id] = log
    session.put(READ, logs)
    return list(logs.values())


def _runs(logs: Sequence[importing.Imported], machine: Machine) -> list[importing.Imported]:
    """Payload and start of each run."""
    kind, made = kind_of(machine), []
    for log in logs:
        name, load, start = st.columns([2.0, 1.0, 1.0], vertical_alignment="bottom")
        samples = len(max(log.channels, key=lambda channel: len(channel.time_s)).time_s)
        name.markdown(f"**{plain(log.name)}** · {len(log.channels)} channels, {samples:,} samples at most")
        payload = None
        if kind.payload:
            payload = load.number_input("Payload (kg)", 0.0, value=None, step=None, format="%.6g",
                                        key=f"import payload {log.name}", placeholder="needed")  # fmt: skip
        position = start.number_input(f"Start ({kind.moved.unit})", value=None, step=None, format="%.6g",
                                      key=f"import start {log.name}",
                                      placeholder="needed" if kind.payload else "not known")  # fmt: skip
        made.append(importing.Imported(log.file, log.channels, payload, position))
    return made


def _mapping(machine: Machine, logs: Sequence[importing.Imported]) -> importing.Proposed:
    """The proposal, as the choices of columns and units change it."""
    channels = logs[0].channels
    columns = [channel.name for channel in channels]
    signals = [name for name in kind_of(machine).signals.names if name != "time_s"]
    try:
        first = {p.signal: p for p in importing.propose(machine, channels).proposals}
    except InputError:  # a needed signal has no column yet: the choices below give it one
        first = {}
    mapped, left_out = [], set()
    with st.expander("Which column is what, in which unit", expanded=not first):
        for signal in signals:
            left, right = st.columns([2.0, 1.0])
            usual = first[signal].column if signal in first else NONE
            words = f"{words_of(signal)} ({unit_of(signal)})"
            column = left.selectbox(words, [NONE, *columns], key=held(f"import {signal}", usual))
            units = [
                AS_WRITTEN,
                *(unit for unit, (of, _) in importing.UNITS.items() if of == importing.quantity_of(signal)),
                importing.NOMINAL,
            ]
            guessed = first[signal].by_size or AS_WRITTEN if signal in first else AS_WRITTEN
            unit = right.selectbox("unit", units, key=held(f"import {signal} unit", guessed, units))
            if column == NONE:
                left_out.add(signal)
            else:
                mapped.append(f"{signal}={column}" + ("" if unit == AS_WRITTEN else f":{unit}"))
    kept = []
    for one in importing.propose(machine, channels, mapped).proposals:
        said = first.get(one.signal, one)
        if one.signal not in left_out:  # what stands as it was proposed says why
            kept.append(said if (said.column, said.factor) == (one.column, one.factor) else one)
    return importing.Proposed(
        tuple(kept), tuple(name for name in columns if name not in {proposal.column for proposal in kept})
    )


def _make(machine: Machine, logs: Sequence[importing.Imported], proposed: importing.Proposed) -> None:
    """Checks all, makes the campaign this session's own, and offers it as a zip."""
    name = st.text_input("Name of the campaign", key=held("import name", "campaign"), max_chars=60)
    if st.button("Check and make the campaign", type="primary", icon=":material/done_all:", key="import make"):
        with tempfile.TemporaryDirectory(dir=session.workspace()) as own, st.spinner("Checking"):
            file, folder, packed = Path(own) / "machine.yaml", Path(own) / "campaign", io.BytesIO()
            save_machine(machine, file)
            importing.write_campaign(file, logs, proposed, folder)
            with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
                for part in filter(Path.is_file, sorted(folder.rglob("*"))):
                    archive.write(part, part.relative_to(folder))
        called = safe_name(name) or "campaign"
        arrived([Uploaded(f"{called}.zip", packed.getvalue())])
        session.put(MADE, (called, packed.getvalue()))
    made = session.get(MADE, tuple, ())
    if made:
        st.success(f"{plain(made[0])} is a campaign: choose it on Signals, Validate and Gap.", icon=":material/check:")
        downloads("import", [("Campaign as a zip", made[1], f"{made[0]}.zip", "application/zip")])
        campaign = last_campaign()
        notes(campaign.all_notes if campaign is not None else ())
