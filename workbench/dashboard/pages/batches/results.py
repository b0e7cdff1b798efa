"""What a finished batch came to: its numbers, conclusions, figures, runs and files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import streamlit as st

from workbench.dashboard import session
from workbench.dashboard.jobs.job import Job, result_folder
from workbench.dashboard.pages.batches.work import CSV, REPORT
from workbench.dashboard.widgets import Number, chart, numbers, plain, table
from workbench.study.labels import run_in_words, swept_axes
from workbench.study.rows import INDEX, Row, metrics_of, read_table
from workbench.study.store import Finished, read_finished

if TYPE_CHECKING:
    from workbench.reports.study import Noted

MOST_LINES = 1_000


def show_results(job: Job) -> None:
    """Everything about a batch that is done. InputError where its result is damaged."""
    folder = result_folder(job)
    if folder is None:
        return
    result, figures = _read(job, folder)
    count = len(result.rows)
    st.subheader(f"{result.name} · {count:,} run{'s' if count != 1 else ''}")
    _numbers(result)
    _downloads(job, folder, result.name)
    said, drawn, runs, how = st.tabs(["Conclusions", "Figures", "Runs", "What was run"])
    with said:
        _conclusions(result)
    with drawn:
        _figures(job, figures)
    with runs:
        _runs(folder, len(result.rows))
    with how:
        from workbench.reports.study import what_was_run

        table(what_was_run(result))
        st.code((folder / "scenario.yaml").read_text(encoding="utf-8"), language="yaml")


def _read(job: Job, folder: Path) -> tuple[Finished, list[Noted]]:
    """Read and drawn once for as long as it is the one that is open."""
    from workbench.reports.study import figures_of

    last = session.get("batches result", tuple, ())
    if not last or last[0] != job.id:
        result = read_finished(folder)
        last = (job.id, (result, figures_of(result)))
        session.put("batches result", last)
    read_before: tuple[Finished, list[Noted]] = last[1]
    return read_before


def _numbers(result: Finished) -> None:
    good = [row for row in result.rows if row.ok]
    if not good:
        return
    axes, judged = swept_axes(good), metrics_of(good)
    tracking = next(
        iter(judged.by_name[name] for name in judged.by_name if name.startswith("tracking_error_max")), None
    )
    ends: tuple[tuple[str, Row, str, float, str], ...]
    if tracking is None:
        ends = (
            ("Largest torque peak", _most(good, "peak_torque_percent"), "peak_torque_percent", 1.0, "%"),
            ("Largest speed error", _most(good, "speed_error_max_rad_s"), "speed_error_max_rad_s", 1.0, "rad/s"),
            ("Least wire tension", _least(good, "min_wire_tension_n"), "min_wire_tension_n", 1e-3, "kN"),
            ("Shortest move time", _least(good, "move_time_s"), "move_time_s", 1.0, "s"),
        )
    else:
        ends = (
            (f"Largest {judged.input_words} peak", _most(good, judged.peak), judged.peak, 1.0, judged.input_unit),
            (tracking.title, _most(good, tracking.name), tracking.name, tracking.scale, tracking.shown_unit),
            ("Shortest move time", _least(good, "move_time_s"), "move_time_s", 1.0, "s"),
        )
    numbers([Number(what, scale * row[name], unit) for what, row, name, scale, unit in ends])
    runs = {what: run_in_words(row, axes) for what, row, *_ in ends}
    sentence = "; ".join(f"{what.lower()} in {run}" for what, run in runs.items())
    st.caption(
        plain(f"{sentence[0].upper()}{sentence[1:]}." if len(set(runs.values())) > 1 else f"All in {runs[ends[0][0]]}.")
    )


def _most(rows: Sequence[Row], name: str) -> Row:
    return max(rows, key=lambda row: row[name])


def _least(rows: Sequence[Row], name: str) -> Row:
    return min(rows, key=lambda row: row[name])


def _downloads(job: Job, folder: Path, name: str) -> None:
    files = [
        ("Report", job.folder / REPORT, f"{name}.html", "text/html"),
        ("Index (CSV)", job.folder / CSV, f"{name}.csv", "text/csv"),
        ("Index (Parquet)", folder / INDEX, f"{name}.parquet", "application/vnd.apache.parquet"),
        ("Scenario", folder / "scenario.yaml", f"{name}.yaml", "application/yaml"),
    ]
    with st.container(horizontal=True):
        for label, path, called, kind in files:
            st.download_button(
                label, path.read_bytes, called, kind, key=f"batches download {label}", icon=":material/download:",
                on_click="ignore",
            )  # fmt: skip


def _conclusions(result: Finished) -> None:
    from workbench.reports.study import conclusions

    if description := str(result.scenario.get("description") or ""):
        st.markdown(plain(description))
    st.markdown("\n".join(f"- {plain(sentence)}" for sentence in conclusions(result)))


def _figures(job: Job, figures: Sequence[Noted]) -> None:
    if not figures:
        st.info("No run succeeded, so there is nothing to draw.")
    for number, (figure, note) in enumerate(figures):
        chart(figure, key=f"batch-{job.id}-{number}", alt=note or None)
        if note:
            st.caption(plain(note))


def _runs(folder: Path, count: int) -> None:
    from workbench.reports.study import run_tables
    from workbench.study.rows import rows_of

    index = read_table(folder / INDEX)
    for run_table in run_tables(rows_of(index)):
        table(run_table)
    st.markdown("**Index**")
    shown = index.drop_columns(["scenario"]).slice(0, MOST_LINES)
    st.dataframe(
        shown,
        hide_index=True,
        lazy=False,
        column_config={
            column.name: st.column_config.NumberColumn(format="%.5g")
            for column in shown.schema
            if str(column.type) == "double"
        },
    )
    if count > MOST_LINES:
        st.caption(f"The first {MOST_LINES} of {count} runs; the downloads hold all.")
