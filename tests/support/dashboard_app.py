"""The dashboard's pages under test: one page alone in streamlit's own test bench; jobs that run beside it."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench.dashboard import jobs
from workbench.dashboard.jobs import Job, Progress, Teller
from workbench.dashboard.widgets import CHART

if TYPE_CHECKING:
    from streamlit.testing.v1 import AppTest

SLOWEST_S = 240.0  # a first run may compile kernels, on a computer that does other work too


def page(title: str, **state: Any) -> AppTest:
    """The page, not yet run, its folds open; `page("Study").run()` draws it. state: of the session, "_" for blanks."""
    from streamlit.testing.v1 import AppTest

    app = AppTest.from_string(
        f"from workbench.dashboard.shell import run_page\nrun_page({title!r})\n", default_timeout=SLOWEST_S
    )
    folds = ("against", "decision", "drive", "feed", "further", "lights", "scenario", "signals")
    for key, value in ({f"fold {name}": True for name in folds} | state).items():
        app.session_state[key.replace("_", " ")] = value
    return app


def good(app: AppTest) -> AppTest:
    """The page, which shows neither a defect nor an error."""
    assert not app.exception and errors(app) == [], [*(e.value for e in app.exception), *errors(app)]
    return app


def errors(app: AppTest) -> list[str]:
    """The errors that the page shows, as sentences."""
    return [shown.value.replace("\\", "") for shown in app.error]


def words(app: AppTest) -> str:
    """What the page says, without its errors."""
    said = " ".join(element.value for element in [*app.markdown, *app.caption, *app.info])
    return said.replace("\\", "").replace("\u00a0", " ")


def figures(app: AppTest) -> list[dict[str, Any]]:
    """The figures that the page shows, as Plotly reads them: data and layout."""
    drawn = [chart.proto.bytes for chart in app.get("bidi_component") if chart.proto.component_name == CHART]
    return [json.loads(said)["figure"] for said in drawn if said]


def titles(app: AppTest) -> list[str]:
    return [figure["layout"]["title"].get("text", "") for figure in figures(app)]


def metrics(app: AppTest) -> dict[str, tuple[str, str]]:
    """Label -> value and delta."""
    return {metric.label: (metric.value, metric.delta) for metric in app.metric}


def downloads(app: AppTest) -> list[str]:
    return [element.proto.label for element in app.get("download_button")]


def sent(app: AppTest, text: str, key: str) -> AppTest:
    """The page after a file of this text was sent, under a name that would lead elsewhere."""
    app.file_uploader(key=key).upload("../../etc/evil name.yaml", text.encode(), "application/yaml")
    return app.run()


# ---- jobs -----------------------------------------------------------------------------------------------------------


def until(job: Job, fact: Callable[[Progress], bool]) -> Progress:
    end = time.monotonic() + SLOWEST_S
    while not fact(progress := jobs.poll(job)):
        assert time.monotonic() < end, progress
        time.sleep(0.02)
    return progress


def ended(job: Job) -> Progress:
    return until(job, lambda progress: progress.ended)


def the_job(server: Path, kind: str | None = None) -> Job:
    """The one of the only visitor of a server whose folder this is."""
    (work,) = server.glob("work-*")
    return jobs.jobs_of(work, kind)[0]


def after(app: AppTest, job: Job) -> AppTest:
    """The page once the job has ended."""
    ended(job)
    app.run()
    assert not app.exception
    return app


def end_all(workspace: Path) -> None:
    for job in jobs.jobs_of(workspace):
        while not jobs.poll(job).ended:
            jobs.stop(job)
            time.sleep(0.05)


def made_job(folder: Path, kind: str, title: str, call: str, arguments: dict[str, Any]) -> Job:
    """A job whose work was done at once, in this process."""
    job = Job(folder / "jobs" / jobs.new_id(), kind, title, call, arguments, time.time())
    job.write()
    tell = Teller(job)
    tell.write(ended=jobs.work(job, tell), at_s=time.time())
    return job
