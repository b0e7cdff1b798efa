"""The page Sizing: the drive that `workbench size` takes for the file that the page offers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.support.dashboard_app import ended, errors, page, the_job, words
from workbench.core.yaml_strict import dumps, loads
from workbench.dashboard import jobs
from workbench.dashboard.pages import sizing
from workbench.machines import default_hoist
from workbench.study.size import size
from workbench.view.size import sentences

CATALOGUE = "name,power_kw,speed_rpm,inertia_kg_m2\nsmall,22,1480,0.2\nlarge,90,1485,1.2\n"


def test_what_the_page_takes_is_what_the_command_takes_for_the_pages_file(server: Path):
    app = page("Sizing").run()
    assert not app.exception and errors(app) == []
    app.file_uploader(key="sizing catalogue").upload("my motors.csv", CATALOGUE.encode(), "text/csv")
    app.segmented_control(key="sizing ratios").set_value("the machine's")
    app.number_input(key="sizing share 9000").set_value(3.0)
    app.number_input(key=f"sizing {default_hoist().name} winch drum_diameter_m").set_value(0.65)
    app.number_input(key="sizing wire safety_factor").set_value(5.0).run()
    assert not app.exception and errors(app) == []
    app.button(key="sizing start").click().run()
    job = the_job(server, sizing.KIND)
    assert ended(job).state == "done", jobs.poll(job).sentence
    own: Any = loads((job.file("inputs") / sizing.SIZE).read_text(), "size.yaml").data
    assert own["wire"]["safety_factor"] == 5.0 and own["payloads"][-1]["share"] == 0.6
    found = size(job.file("inputs") / sizing.SIZE)
    machine: Any = found.study.machine
    assert machine.winch.drum_diameter_m == 0.65
    assert {candidate.motor.name for candidate in found.candidates} == {"small", "large"}
    app.run()
    assert all(sentence in words(app) for sentence in sentences(found))
    # a smaller bound is harder to keep: the page's answer follows its own file
    harder = job.file("inputs") / "harder.yaml"
    harder.write_text(dumps({**own, "wire": {**own["wire"], "breaking_load_n": 1000.0}}))
    assert size(harder).taken is None
