"""The page Batches: a scenario of many runs, run in a process of its own, watched, opened."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path

import streamlit as st

from workbench.core.errors import InputError
from workbench.core.yaml_strict import Document, dumps, load
from workbench.dashboard import jobs, session, widgets
from workbench.dashboard.chosen import session_machine
from workbench.dashboard.desk import shipped_scenarios
from workbench.dashboard.jobs import INPUTS, Job, Teller
from workbench.dashboard.widgets import Number, guarded, held, plain, table
from workbench.machines import save_machine
from workbench.metrics import View, shown_in
from workbench.study.labels import run_in_words, swept_axes
from workbench.study.load import load_study, read_standalone
from workbench.study.rows import INDEX, metrics_of, read_table, rows_of
from workbench.study.run import StudyResult
from workbench.study.store import Progress, place_for, read_finished, run_batch
from workbench.view.style import label

KIND, OPEN = "batch", "batches open"
UPLOAD = "upload a scenario"
MOST_RUNS = 100_000
MOST_RUNS_WITH_SIGNALS = 1_000  # some hundred kilobytes each
MOST_LINES = 1_000  # of the index, on the page
SCENARIO, MACHINE, ON_MACHINE = "scenario.yaml", "machine.yaml", "on_machine.yaml"
CSV, REPORT = "index.csv", "report.html"


def show() -> None:
    """Draws the page."""
    with st.sidebar, guarded(stop=False):  # the batches that run are shown all the same
        _new()
    own = session.own_jobs(KIND)
    opened = next((job for job in own if job.id == st.session_state.get(OPEN)), None)
    if opened is None:  # after a reload: the newest that is done
        opened = next((job for job in own if jobs.poll(job).state == "done"), None)
        session.put(OPEN, opened.id if opened else None)
    if own:
        jobs.cards(own, OPEN, "runs")
    else:
        st.info("No batch yet. Choose a scenario and start it: it runs in a process of its own and goes on while you "
                "look at other pages.")  # fmt: skip
    if opened is not None and jobs.poll(opened).state == "done":
        with guarded(stop=False):
            _results(opened)


def work(out: Path, tell: Teller, scenario: str) -> None:
    """In the worker: runs the scenario of that file; beside the result its index as CSV and its report come to lie.

    Goes on where an earlier call was stopped. InputError for a scenario that cannot be run.
    """
    from pyarrow.csv import write_csv

    from workbench.view.study import write_study_report

    begun = time.monotonic()

    def told(progress: Progress) -> None:
        seconds, made = time.monotonic() - begun, progress.done - progress.kept
        tell("runs", progress.done, progress.runs, progress.failed, made / seconds if seconds > 0.1 else 0.0)

    study = load_study(scenario)
    place = place_for(study, out)
    if not place.finished:
        run_batch(study, place, tell=told)
    failed = read_finished(out).manifest["runs"]["failed"]
    tell("writing the report", 0, 1, failed)
    write_csv(read_table(out / INDEX), out.parent / CSV)
    write_study_report(read_finished(out), out.parent / REPORT)
    tell("runs", len(study.specs), len(study.specs), failed)


def _new() -> None:
    """The side bar: a scenario, what it would run, the button that starts it. InputError for a bad scenario."""
    ships = shipped_scenarios()
    usual = "payloads" if "payloads" in ships else next(iter([*ships, UPLOAD]))
    name = st.selectbox("Scenario", [*ships, UPLOAD], key=held("batches scenario", usual))
    file, inputs = ships.get(name), dict[str, Path]()  # of which the worker gets copies
    if file is None:
        upload = st.file_uploader("scenario.yaml", type=["yaml", "yml"], key="batches upload", max_upload_size=1)
        if upload is None:
            st.info("Choose a scenario file.", icon=":material/upload:")
            return
        file = inputs[SCENARIO] = session.stored(upload, SCENARIO)
    own = st.toggle("On another machine", key="batches other machine", help="Than the one that the scenario names.")
    machine = session_machine("batches machine") if own else None
    if name == UPLOAD:
        document, known = load(file), {batch.name: batch for batch in ships.values()}
        read_standalone(document, machine, known)  # what other files it names are not sought among the server's
        inputs |= extended(document, known)
    if machine is not None:
        save_machine(machine, inputs.setdefault(MACHINE, session.workspace() / MACHINE))
        # Beside its copy where the scenario is uploaded, in its own place where it ships.
        base = SCENARIO if name == UPLOAD else str(file)
        file = inputs[ON_MACHINE] = session.workspace() / ON_MACHINE
        file.write_text(dumps({"extends": base, "machine": MACHINE}), encoding="utf-8")
    # A large study takes a second to be checked: it is read anew only when a file has changed.
    state, asked = [(str(path), path.read_bytes()) for path in (file, *inputs.values())], file
    study = session.once("batches study", state, lambda: load_study(asked))
    runs, signals = len(study.specs), study.scenario.outputs.signals
    if runs > MOST_RUNS:
        raise InputError(f"{runs} runs, expected at most {MOST_RUNS} here; `workbench study` takes more", place="sweep")
    if signals != "none" and runs > MOST_RUNS_WITH_SIGNALS:
        said = f"{runs} runs that keep their signals, expected at most {MOST_RUNS_WITH_SIGNALS} here"
        raise InputError(f"{said}; write `outputs: {{signals: none}}`", place="outputs")
    if study.scenario.description:
        st.markdown(plain(study.scenario.description))
    payloads = len({spec.payload_kg for spec in study.specs[:2000]})
    kinds = ", ".join(label(kind) for kind in study.scenario.kinds)
    st.markdown(
        f"**{runs:,} runs** of {study.duration_s:.0f} s each: {payloads} "
        f"payload{'s' if payloads != 1 else ''}, {plain(kinds)}, on {plain(study.machine.name)}."
    )
    with st.expander("The scenario's file"):
        st.code(file.read_text(encoding="utf-8"), language="yaml")
    if st.button("Start", key="batches start", type="primary", icon=":material/play_arrow:"):
        call = {"scenario": f"{INPUTS}/{file.name}" if file.name in inputs else str(file)}
        job = jobs.start(KIND, f"{__name__}:work", call, session.new_work_folder(), study.scenario.name, inputs)
        session.put(OPEN, job.id)
        st.rerun()


def extended(document: Document, known: Mapping[str, Path]) -> dict[str, Path]:
    """Copies in the session's folder, beside the upload, of the scenarios that ship and that a document extends."""
    copies: dict[str, Path] = {}
    while isinstance(document.data, dict) and (name := str(document.data.get("extends", "")).rpartition("/")[2]):
        copies[name] = session.workspace() / known[name].name
        copies[name].write_bytes(known[name].read_bytes())
        document = load(copies[name])
    return copies


def _results(job: Job) -> None:
    """Everything about a batch that is done. InputError where its result is damaged."""
    from workbench.view.study import conclusions, figures_of, run_tables, what_was_run

    folder = job.file("result")
    result = session.once("batches result", job.id, lambda: read_finished(folder))
    figures = session.once("batches figures", job.id, lambda: figures_of(result))
    count = len(result.rows)
    st.subheader(f"{result.name} · {count:,} run{'s' if count != 1 else ''}")
    _numbers(result)
    with st.container(horizontal=True):
        files = (
            ("Report", job.file(REPORT), "html", "text/html"),
            ("Index (CSV)", job.file(CSV), "csv", "text/csv"),
            ("Index (Parquet)", folder / INDEX, "parquet", "application/vnd.apache.parquet"),
            ("Scenario", folder / SCENARIO, "yaml", "application/yaml"),
        )
        shown = [(words, path.read_bytes, f"{result.name}.{ending}", kind) for words, path, ending, kind in files]
        widgets.downloads("batches download", shown)
    told, drawn, runs, how = st.tabs(["Conclusions", "Figures", "Runs", "What was run"])
    with told:
        if description := str(result.scenario.get("description") or ""):
            st.markdown(plain(description))
        widgets.points(conclusions(result))
    with drawn:
        if not figures:
            st.info("No run succeeded, so there is nothing to draw.")
        widgets.figures(figures, f"batch-{job.id}")
    with runs:
        index = read_table(folder / INDEX)
        for run_table in run_tables(rows_of(index)):
            table(run_table)
        st.markdown("**Index**")
        lines = index.drop_columns(["scenario"]).slice(0, MOST_LINES)
        numeric = [column.name for column in lines.schema if str(column.type) == "double"]
        config = {name: st.column_config.NumberColumn(format="%.5g") for name in numeric}
        st.dataframe(lines, hide_index=True, lazy=False, column_config=config)
        if count > MOST_LINES:
            st.caption(f"The first {MOST_LINES} of {count} runs; the downloads hold all.")
    with how:
        table(what_was_run(result))
        st.code((folder / SCENARIO).read_text(encoding="utf-8"), language="yaml")


def _numbers(result: StudyResult) -> None:
    """The worst over all runs of the numbers that decide, each with the run that it is of."""
    good = [row for row in result.rows if row.ok]
    axes, cards, where = swept_axes(good), list[Number](), list[str]()
    for metric in shown_in(View.CARDS, metrics_of(good)) if good else ():
        if known := {row[metric.name]: row for row in reversed(good) if row.metrics.get(metric.name) is not None}:
            worst = metric.worst(list(known))
            cards.append(Number(metric.heading, metric.scale * worst, metric.shown_unit))
            where.append(f"{metric.heading.lower()}: {run_in_words(known[worst], axes)}")
    if cards:
        widgets.numbers(cards)
        st.caption(plain(f"The worst of all runs: {'; '.join(where)}."))
