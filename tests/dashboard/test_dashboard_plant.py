"""The pages Plant and Machine: a plant that is served and seen, a drawing that follows a run."""

from __future__ import annotations

import gc
import json
import time
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.serve import Served
from tests.support.dashboard_app import errors, good, page
from tests.support.simulated_campaign import simulated_campaign
from tests.view.test_report import contrast
from workbench.analysis.usual import usual_controller
from workbench.core.errors import InputError
from workbench.core.run import Run
from workbench.dashboard.pages.machine import LARGE
from workbench.dashboard.plant import BUILT_IN, READ, Controller, Numbers, PlantProcess, Recorder, Wanted
from workbench.logs import read_campaign
from workbench.machines import default_hoist
from workbench.serve.plant import LivePlant
from workbench.serve.serve import Wish
from workbench.serve.session import TORQUE, Session
from workbench.simulate.loop import LoopCase, simulate_loop
from workbench.view.film import HEIGHT, Scene, film, look_of, scene_of
from workbench.view.style import GROUND

HOIST = default_hoist()
PI = usual_controller(HOIST)
STEP_S, START_M, PAYLOAD_KG = 0.001, 9.0, 4500.0
WITHIN_S = 60.0


class ByHand:
    """A session on a clock that is set by hand, and what a page sees of it."""

    def __init__(self) -> None:
        self.now = 0.0
        self.session = Session(LivePlant(HOIST, STEP_S, PAYLOAD_KG, START_M), STEP_S, 0.2, clock=lambda: self.now)
        own = lambda order: self.session.order(order, BUILT_IN)  # noqa: E731
        self.seen = Recorder(self.session.order, HOIST, deque(["hello"]), own)

    def driven(self, controller: Controller, seconds: float) -> list[Numbers]:
        """The plant under the built-in client, without a thread or a wait; the states at its samples."""
        seen = []
        for _ in range(round(seconds / controller.dt)):
            seen.append(self.session.order({"get": list(READ)})["get"])
            self.session.order({"set": {TORQUE: controller.torque_nm(seen[-1], PAYLOAD_KG)}})
            for _ in range(round(controller.dt / STEP_S)):
                self.now += STEP_S
                self.session.step()
        return seen


@pytest.fixture
def plant() -> ByHand:
    return ByHand()


def test_the_built_in_client_holds_the_load_and_another_one_that_is_picked_up(plant: ByHand):
    controller = Controller(HOIST, Wanted(PI))
    begun = plant.driven(controller, 1.0)[0]
    plant.session.order({"set": {"payload_kg": 9000.0}})
    (*_, last) = plant.driven(controller, 4.0)
    assert abs(last["speed_motor_rad_s"]) < 0.1
    assert last["position_carriage_m"] == pytest.approx(begun["position_carriage_m"], abs=0.05)
    grown = last["torque_at_work_nm"] / begun["torque_at_work_nm"]
    carried = (HOIST.carriage.mass_kg + 9000.0) / (HOIST.carriage.mass_kg + 4500.0)
    assert grown == pytest.approx(carried, rel=0.03)


def test_the_built_in_client_yields_to_another_one(plant: ByHand):
    session, seen = plant.session, plant.seen
    seen.use(Wanted(PI))
    end = time.monotonic() + WITHIN_S
    while session.controller is None and time.monotonic() < end:
        time.sleep(0.01)
    seen.take()
    assert seen.seen()["client_at_work"]
    with pytest.raises(InputError, match="read only: the built-in client controls the plant"):
        session.command(400.0, who="a PLC")
    session.refused("second_client", "a PLC is not heard")  # as each protocol counts it
    seen.take()
    assert not seen.seen()["client_at_work"]
    assert seen.seen()["client_ended"].startswith("another client commands this plant")
    plant.now += 1.0
    session.step()  # the built-in one is silent
    assert session.command(400.0, who="a PLC") and session.controller == "a PLC"


def test_a_plant_of_another_process_is_reached_over_udp():
    with Served(HOIST, watchdog_s=0.2) as served:
        process = PlantProcess(HOIST, served.port)
        assert process.greeting(WITHIN_S)
        asked = process.ask("order", {"set": {"slack_m": 0.1, "brake_closed": 1}, "get": ["slack_m"]})
        assert asked["get"] == {"slack_m": 0.1}
        with pytest.raises(InputError, match="unknown point 'slak_m'"):
            process.ask("order", {"set": {"slak_m": 0.1}})
        process.end()


def until(app: Any, there: Any) -> Any:
    end = time.monotonic() + WITHIN_S
    while not there(app):
        assert time.monotonic() < end, [element.value for element in app.markdown]
        time.sleep(0.1)
        app.run()
    return app


def test_a_plant_is_started_faulted_moved_and_stopped_on_its_page_and_ends_with_its_session():
    app = page("Plant").run()
    assert not app.exception and "plant stop" not in {button.key for button in app.button}
    app.button(key="plant start").click().run()
    until(app, lambda app: len(app.metric) == 5)
    process = app.session_state["plant process"]
    assert any("waits for the first command" in element.value for element in app.markdown)
    app.segmented_control(key="plant client").set_value("holds").run()
    app.number_input(key="plant fault payload_kg").set_value(6000.0).run()
    app.button(key="plant do payload_kg").click().run()
    app.toggle(key="plant fault motor_lost").set_value(True).run()
    until(app, lambda app: [element.value for element in app.metric if element.label == "Payload"] == ["6000 kg"])
    good(app)
    told = process.ask("order", {"get": ["is_motor_lost", "is_waiting", "payload_now_kg"]})["get"]
    assert told == {"is_motor_lost": 1.0, "is_waiting": 0.0, "payload_now_kg": 6000.0}
    app.number_input(key="plant effects.gearbox_efficiency.loss_fraction").set_value(-2.0).run()
    app.button(key="plant effect do").click().run()
    assert "gearbox_efficiency.loss_fraction" in errors(app)[0]
    app.button(key="plant stop").click().run()
    assert not process.alive and app.button(key="plant start") and not app.exception


def test_a_plants_process_ends_with_its_session_and_says_what_was_wrong():
    process = PlantProcess(HOIST, Wish(port=0, start_position_m=999.0))
    with pytest.raises(InputError, match=r"start_position_m: 999 m, expected .* the rail"):
        process.greeting(WITHIN_S)
    ended = process._process
    del process
    gc.collect()
    assert ended.poll() is not None


# The page Machine: the drawing follows the run, its tensions are the model's.


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
