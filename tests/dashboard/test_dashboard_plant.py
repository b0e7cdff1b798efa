"""The page Plant: the built-in client closes the loop, what is seen of a plant, its process ends with its session."""

from __future__ import annotations

import gc
import time
from collections import deque
from typing import Any

import pytest

from benchmarks.serve import Served
from tests.support.dashboard_app import errors, good, page
from workbench.analysis.usual import usual_controller
from workbench.core.errors import InputError
from workbench.dashboard.plant import BUILT_IN, READ, Controller, Numbers, PlantProcess, Recorder, Wanted
from workbench.machines import default_hoist
from workbench.serve.plant import LivePlant
from workbench.serve.serve import Wish
from workbench.serve.session import TORQUE, Session

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
