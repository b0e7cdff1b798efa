"""The page Plant: the built-in client closes the loop, what is seen of a plant, its process ends with its session."""

from __future__ import annotations

import gc
import socket
import time
from collections import deque
from typing import Any

import numpy as np
import pytest

from benchmarks.serve import Served
from tests.support.dashboard_app import errors, good, page
from workbench.analysis.usual import usual_controller
from workbench.core.errors import InputError
from workbench.dashboard.pages.plant import WINDOWS
from workbench.dashboard.plant import (
    BUILT_IN,
    KEPT_S,
    PAUSE_S,
    READ,
    Controller,
    Numbers,
    PlantProcess,
    Recorder,
    Wanted,
    udp_order,
)
from workbench.machines import default_hoist
from workbench.references import Limits
from workbench.references.shape import shortest_move_s
from workbench.serve.plant import LivePlant
from workbench.serve.serve import Wish
from workbench.serve.session import TORQUE, Session
from workbench.view.served import last_seconds, late_starts

HOIST = default_hoist()
PI = usual_controller(HOIST)
LIMITS = Limits(0.5, 0.6, 2.0)
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


def test_the_built_in_client_goes_up_and_down_between_two_heights(plant: ByHand):
    controller = Controller(HOIST, Wanted(PI, (8.5, 9.6), "ruckig", LIMITS))
    takes = sum(shortest_move_s(by, LIMITS) + PAUSE_S for by in (0.6, -1.1))
    heights = [state["position_carriage_m"] for state in plant.driven(controller, takes)]
    assert max(heights) == pytest.approx(9.6, abs=0.02) and heights[-1] == pytest.approx(8.5, abs=0.02)


def test_the_built_in_client_begins_anew_after_the_brake_and_after_a_reset(plant: ByHand):
    controller, order = Controller(HOIST, Wanted(PI)), plant.session.order
    plant.driven(controller, 0.5)
    order({"set": {"brake_closed": 1}})
    assert plant.driven(controller, 0.5)[-1]["is_brake_closed"]
    order({"set": {"brake_closed": 0}})
    freed = plant.driven(controller, 0.5)[-1]
    assert not freed["is_brake_closed"] and abs(freed["speed_motor_rad_s"]) < 0.2
    order({"set": {"reset": 1}})
    again = plant.driven(controller, 0.2)
    assert again[0]["is_waiting"] and again[-1]["time_s"] == pytest.approx(0.2, abs=0.01)
    assert abs(again[-1]["speed_motor_rad_s"]) < 0.1


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


def test_what_is_seen_grows_with_the_plants_time_and_begins_anew_after_a_reset(plant: ByHand):
    session, seen = plant.session, plant.seen
    assert seen.seen()["now"] == {}
    session.order({"set": {TORQUE: session.plant.hold}})
    for _ in range(5):
        session.step()
        seen.take()
    seen.take()  # its time stands
    assert seen.seen()["columns"]["time_s"] == pytest.approx([k * 1e-3 for k in range(1, 6)])
    seen.order({"set": {"motor_lost": 1}}, "motor lost")
    assert seen.seen()["events"] == [(0.005, "motor lost")] and session.plant.motor_lost
    assert seen.seen()["said"] == ["hello"]
    with pytest.raises(InputError, match="unknown point"):
        seen.order({"set": {"moter_lost": 1}})
    session.reset()
    seen.take()
    assert len(seen.seen()["columns"]["time_s"]) == 1 and seen.seen()["events"] == []
    seen.use(Wanted(PI))
    seen.use(None)
    assert not seen.seen()["client_at_work"]


def numbers_over(time_s: Any) -> dict[str, Any]:
    read = ByHand().session.order({"get": list(READ)})["get"]
    columns = {name: np.full(len(time_s), value) for name, value in read.items()}
    return columns | {"time_s": time_s, "speed_reference_rad_s": np.full(len(time_s), np.nan)}


def test_figures_of_a_plant_hold_its_last_seconds_its_events_and_every_step():
    columns = numbers_over(np.arange(0.0, 30.0, 0.04))
    figure = last_seconds(columns, 10.0, 1500.0, [(5.0, "too early"), (25.0, "slack")])
    words = {note.text for note in figure.layout.annotations}
    assert "slack" in words and "too early" not in words and "limit" not in words
    names = {line.name for line in figure.data}
    assert {"height", "motor", "at work", "drum", "dead line", "least"} <= names and "set point" not in names
    assert min(figure.data[0].x) > 19.9
    assert list(late_starts({"<10 us": 3, ">=10 us": 1}).data[0].y) == [75.0, 25.0]
    assert max(WINDOWS) <= KEPT_S


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_limit_of_torque_is_drawn_where_the_torque_comes_near_it(sign: float):
    columns = numbers_over(np.arange(0.0, 1.0, 0.04))
    near = last_seconds(columns | {"torque_at_work_nm": sign * (1400.0 + columns["time_s"])}, 10.0, 1500.0)
    assert sign * 1500.0 in {shape.y0 for shape in near.layout.shapes if shape.type == "line"}


def test_a_plant_of_another_process_is_reached_over_udp():
    with Served(HOIST, watchdog_s=0.2) as served:
        process = PlantProcess(HOIST, served.port)
        assert process.greeting(WITHIN_S)
        asked = process.ask("order", {"set": {"slack_m": 0.1, "brake_closed": 1}, "get": ["slack_m"]})
        assert asked["get"] == {"slack_m": 0.1}
        with pytest.raises(InputError, match="unknown point 'slak_m'"):
            process.ask("order", {"set": {"slak_m": 0.1}})
        process.end()


def test_a_port_without_a_plant_is_one_clear_error():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        with pytest.raises(InputError, match="no plant answers over UDP on port"):
            udp_order(taken.getsockname()[1])({"status": True})


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
