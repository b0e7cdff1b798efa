"""The page Machine: the drawing follows the run, its tensions are the model's."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.dashboard_app import errors, page
from tests.support.simulated_campaign import simulated_campaign
from tests.view.test_figures_legible import contrast
from workbench.analysis.usual import usual_controller
from workbench.core.run import Run
from workbench.dashboard.pages.machine import LARGE
from workbench.logs import read_campaign
from workbench.machines import default_hoist
from workbench.simulate.loop import LoopCase, simulate_loop
from workbench.view.film import HEIGHT, Scene, film, look_of, scene_of
from workbench.view.style import GROUND


@pytest.fixture(scope="module")
def lift() -> Run:
    """Two seconds at rest, then up, and to a stop."""
    time = np.arange(8000) * 0.001
    speed = 100.0 * np.interp(time, [2.0, 3.0, 6.0, 7.0], [0.0, 1.0, 1.0, 0.0])
    machine = default_hoist()
    case = LoopCase("lift", machine, 4500.0, 6.0, usual_controller(machine), speed)
    return simulate_loop([case])[0].run


def scene(lift: Run, **changes: Any) -> Scene:
    made = scene_of(default_hoist(), lift)
    return Scene(**{**vars(made), **changes})


@pytest.mark.parametrize("dark", [False, True])
def test_the_film_is_one_page_that_fetches_nothing(lift, dark):
    page_of = film(default_hoist(), [scene(lift, name="</script><b>x"), scene(lift)], dark)
    assert "http" not in page_of and "@" not in page_of.replace("@media", "")
    assert page_of.count("</script>") == 2 and page_of.count('class="stage"') == 2
    assert len(page_of) < 400_000
    data = json.loads(page_of.partition('id="data">')[2].partition("</script>")[0])
    wire = ["#{:02X}{:02X}{:02X}".format(*colour) for colour in data["viridis"]]  # at every tension
    ground = GROUND if dark else "#FFFFFF"
    assert min(contrast(colour, ground) for colour in [*wire, look_of(dark).faint, look_of(dark).edge]) >= 3.0


def test_a_measured_run_gets_the_tensions_and_heights_of_the_model(lift, tmp_path):
    folder = simulated_campaign(tmp_path / "spring", truth=default_hoist())
    campaign = read_campaign(folder)
    run = campaign.run("half")
    assert "position_carriage_m" not in run and "tension_drum_n" not in run
    shown = scene_of(default_hoist(), run)
    # At rest both falls carry half of carriage and pipe; half of the bare wire's weight is added at the top.
    held = 0.5 * (8000.0 + 4500.0) * 9.81
    assert shown.tension_drum_n[:50].mean() == pytest.approx(held, rel=0.03)
    assert shown.height_m[0] == pytest.approx(9.0, abs=0.01)
    assert np.ptp(shown.height_m) == pytest.approx(2.0, abs=0.05)
    assert "measured motor speed" in shown.tension_of
    assert not shown.slack.any()
    assert 'id="carriage0"' in film(default_hoist(), [shown])


def test_the_page_shows_a_quick_run_and_another_reference_beside_it():
    app = page("Machine").run()
    assert not app.exception and errors(app) == []
    app.selectbox(key="machine beside").set_value("ruckig").run()
    assert not app.exception and "beside ruckig" in app.markdown[0].value
    (frame,) = app.get("iframe")
    assert frame.proto.srcdoc.count('class="stage"') == 2 and f"height: {HEIGHT}px" in frame.proto.srcdoc
    assert "4500 kg" in app.markdown[0].value
    app.slider(key="machine payload").set_value(9000)
    app.toggle(key="machine large").set_value(True).run()
    assert "9000 kg" in app.markdown[0].value and f"height: {LARGE}px" in app.get("iframe")[0].proto.srcdoc
    app.slider(key="machine payload").set_value(12000).run()  # shown, or told
    assert not app.exception


@pytest.fixture
def chosen(offer: Any) -> Any:
    """The state of a session whose Validate page shows a campaign."""

    def at(folder: Path) -> Any:
        offer(folder)
        validate = page("Validate").run()
        app = page("Machine")
        for key in ("campaign chosen", "campaigns read"):
            app.session_state[key] = validate.session_state[key]
        app.run()
        return app.radio(key="machine source").set_value("a run of the campaign").run()

    return at


def test_a_measured_run_of_the_validated_campaign_can_be_shown(chosen, tmp_path):
    app = chosen(simulated_campaign(tmp_path / "spring"))
    app.selectbox(key="machine measured").set_value("full").run()
    assert not app.exception and errors(app) == []
    assert "spring, full" in app.markdown[0].value
    assert "of the model under the measured motor speed" in app.caption[0].value
