"""The served plant: the same motion as in a study, faults on command, clients that are not ours, bad packets."""

from __future__ import annotations

import json
import math
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from benchmarks.serve import Client, Served, case_at, closed_loop, off_percent
from tests.support.commands import Commands
from tests.support.effect_machines import linear_axis
from workbench.core.errors import InputError
from workbench.export.fmu import host_compiler
from workbench.machines import default_hoist, save_machine
from workbench.serve.plant import LiveAxis, LivePlant
from workbench.serve.serve import Wish, pace_lines
from workbench.serve.session import FLAGS, Pace, Session
from workbench.simulate.loop import simulate_loop

HOIST = default_hoist()
BITS = {name: 1 << i for i, (name, _) in enumerate(FLAGS)}


class Hand:
    """A clock that is set by hand."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Hand:
    return Hand()


@pytest.fixture
def said() -> list[str]:
    return []


@pytest.fixture
def session(clock: Hand, said: list[str]) -> Session:
    return Session(LivePlant(HOIST, 0.001, 4500.0, 9.0), 0.001, 0.1, clock=clock, say=said.append)


def steps(session: Session, clock: Hand, count: int, torque_nm: float | None = None) -> None:
    """torque None: the client is silent."""
    for _ in range(count):
        if torque_nm is not None:
            session.command(torque_nm)
        session.step()
        clock.now += session.step_s


# The plant.


def test_a_client_in_lock_step_at_250_hz_closes_the_loop_with_the_metrics_of_the_study():
    case = case_at(250.0, HOIST)
    (study,) = simulate_loop([case], record_every=0)
    with Served(HOIST, rate_hz=250.0, lock_step=True) as served:
        client = Client(served.port)
        metrics = closed_loop(client, case)
        client.close()
    assert metrics.keys() == study.metrics.keys()
    assert metrics == pytest.approx(study.metrics, rel=0.01, abs=1e-6)
    # It is the same step: rounding is all that differs.
    assert max(off_percent(metrics, study.metrics).values()) < 0.01


def test_a_lost_motor_halves_what_the_drive_gives(session: Session, clock: Hand):
    steps(session, clock, 50, 5000.0)
    both = session.plant.at_work
    session.set({"motor_lost": 1})
    steps(session, clock, 50, 5000.0)
    assert both == pytest.approx(2 * 480.0 * 1.6, rel=1e-6)
    assert session.plant.at_work == pytest.approx(480.0 * 1.6, rel=1e-6)
    assert session.flags & BITS["motor_lost"] and session.flags & BITS["limited"]


def test_a_late_brake_holds_for_so_long_after_it_is_asked_to_open(session: Session, clock: Hand):
    session.set({"brake_closed": 1})
    steps(session, clock, 10, session.plant.hold)
    session.set({"brake_late_s": 0.1})
    session.set({"brake_closed": 0})
    steps(session, clock, 99, 1500.0)
    assert session.flags & BITS["brake_closed"]
    assert abs(session.plant.signals["speed_motor_rad_s"]) < 0.1
    steps(session, clock, 30, 1500.0)
    assert not session.flags & BITS["brake_closed"]
    assert session.plant.signals["speed_motor_rad_s"] > 1.0


def test_an_effect_that_is_ready_is_off_until_it_is_set(clock: Hand):
    plain, other = LivePlant(HOIST, 0.001, 4500.0, 9.0), LivePlant(HOIST, 0.001, 4500.0, 9.0, ["friction_viscous"])
    for plant in (plain, other):
        for _ in range(200):
            plant.step(900.0)
    assert other.signals == pytest.approx(plain.signals, rel=1e-9, abs=1e-9)
    other.put(other.effect_parameters("friction_viscous")["viscous_n_s_per_m"][0], 20000.0)
    for plant in (plain, other):
        for _ in range(500):
            plant.step(900.0)
    assert other.signals["speed_motor_rad_s"] < 0.95 * plain.signals["speed_motor_rad_s"]
    with pytest.raises(InputError, match="did you mean 'friction_viscous'"):
        other.effect_parameters("friction_viscos")


# An axis.

AXIS = linear_axis(backward=25.0, constant=5.0)


def test_a_served_axis_nears_the_speed_at_which_friction_and_load_take_its_force(clock: Hand, said: list[str]):
    session = Session(LiveAxis(AXIS, 0.001, start=0.3), 0.001, 0.1, clock=clock, say=said.append)
    assert session.plant.hold == 5.0 and session.plant.signals["position_m"] == 0.3
    force, time_constant_s = 65.0, 95.0 / 200.0
    steps(session, clock, 1000, force)
    top = (force - 20.0 - 5.0) / 200.0
    # Starting takes the distance that friction turns over in, 1e-4 m/s: nothing beside the rest.
    expected = top * (1.0 - math.exp(-1.0 / time_constant_s))
    assert session.plant.signals["velocity_m_s"] == pytest.approx(expected, rel=1e-3)
    assert session.status()["values"]["force_at_work_n"] == force
    steps(session, clock, 2000)
    assert session.flags == BITS["watchdog"] and any("force is zero" in line for line in said)
    assert abs(session.plant.signals["velocity_m_s"]) < 1e-3  # friction has stopped it


def test_a_client_over_udp_pushes_an_axis():
    with Served(AXIS, watchdog_s=5.0) as served:
        client = Client(served.port)
        client.send(65.0, flags=1)  # a brake that it has not
        now, at_work, *rest = client.receive().numbers
        assert now > 0.0 and at_work == 65.0 and len(rest) == 4  # three signals and the time that was left out
        assert client.order({"get": ["velocity_m_s"]})["get"]["velocity_m_s"] > 0.0
        client.close()
    assert any("stands still until the first force; 5.0 N hold it" in line for line in served.said)


def test_time_stands_still_until_the_first_command(session: Session, clock: Hand):
    steps(session, clock, 500)
    assert session.plant.time_s == 0.0 and session.flags & BITS["waiting"]


# The session.


def test_a_silent_client_loses_its_torque_and_the_brake_closes(session: Session, clock: Hand, said: list[str]):
    steps(session, clock, 10, session.plant.hold)
    steps(session, clock, 99)
    assert not session.flags & BITS["watchdog"]
    steps(session, clock, 60)
    assert session.flags & BITS["watchdog"] and session.flags & BITS["brake_closed"]
    assert abs(session.plant.at_work) < 1e-6
    assert any("silent for 0.1 s" in line for line in said)
    steps(session, clock, 5, session.plant.hold)
    assert not session.flags & (BITS["watchdog"] | BITS["brake_closed"])


def test_a_torque_that_is_no_number_is_not_used_and_does_not_feed_the_watchdog(session, clock, said):
    steps(session, clock, 10, 600.0)
    for _ in range(150):
        assert not session.command(float("nan"))
        session.step()
        clock.now += 0.001
    assert session.flags & BITS["watchdog"]
    assert sum("finite number" in line for line in said) == 1
    assert session.counts["refused_not_finite"] == 150


def test_a_carriage_that_leaves_the_rail_stands_until_reset(clock: Hand, said: list[str]):
    plant = LivePlant(HOIST, 0.001, 4500.0, HOIST.highest_position_m - 0.5)
    session = Session(plant, 0.001, 0.1, clock=clock, say=said.append)
    steps(session, clock, 3000, 1500.0)
    stood = session.plant.time_s
    assert session.flags & BITS["off_rail"] and any("left the rail" in line for line in said)
    steps(session, clock, 10, 600.0)
    assert session.plant.time_s == stood
    session.set({"reset": 1})
    assert session.flags == BITS["waiting"] and plant.time_s == 0.0


@pytest.mark.parametrize(
    ("order", "expected"),
    [
        ({"sett": {}}, "did you mean 'set'"),
        ({"set": {"slak_m": 1}}, "did you mean 'slack_m'"),
        ({"set": {"payload_kg": -1}}, "expected 0 to"),
        ({"set": {"payload_kg": "heavy"}}, "expected a finite number"),
        ({"set": {"motor_lost": 2}}, "expected 0 or 1"),
        ([], "expected an object"),
    ],
)
def test_an_order_that_cannot_be_changes_nothing(session: Session, order: object, expected: str):
    with pytest.raises(InputError, match=expected):
        session.order(order)
    assert session.plant.value("m_p") == 4500.0
    assert session.order({"get": ["slack_m"]})["get"] == {"slack_m": 0.0}


# The pace.


def test_late_steps_are_made_up_and_counted():
    pace = Pace(0.001)
    pace.begin(0.0)
    for now in (0.0, 0.001, 0.0051, 0.0052, 0.0053, 0.0054, 0.006):  # 4 ms lost in the third
        assert now >= pace.due_s
        pace.start(now)
        pace.end(now + 0.00005)
    assert (pace.steps, pace.overruns) == (7, 3)
    assert pace.record()["jitter"]["<5000 us"] == 2
    assert "57.143 % on time" in pace_lines(pace.record())[0]


# Clients that are not ours.


@pytest.fixture(scope="module")
def served() -> Iterator[Served]:
    with Served(HOIST, watchdog_s=5.0) as made:
        yield made


@pytest.mark.skipif(host_compiler() is None, reason="no C compiler is here")
def test_a_client_in_c_hoists_the_load_over_udp(tmp_path: Path):
    built = tmp_path / "client"
    words = [host_compiler() or "cc", "-std=gnu99", "-Wall", "-Werror", str(Path(__file__).with_name("client.c"))]
    subprocess.run([*words, "-o", str(built)], check=True)
    with Served(HOIST, lock_step=True) as served:
        hold = served.session.plant.hold
        done = subprocess.run([built, str(served.port), repr(hold), "600"], capture_output=True, text=True, check=True)
    got, now, speed, height, flags = done.stdout.split()
    assert (int(got), int(flags)) == (600, 0) and float(now) == pytest.approx(0.6)
    assert float(speed) == pytest.approx(10.0, rel=0.2) and float(height) > 9.02


def test_a_port_in_use_is_one_line(tmp_path: Path, commands: Commands, served: Served):
    save_machine(HOIST, tmp_path / "machine.yaml")
    done = commands("serve", tmp_path / "machine.yaml", "--port", served.port)
    assert done.status == 2 and f"--port: port {served.port} of 127.0.0.1 is taken" in done.err


def test_the_command_ends_after_its_time_with_the_histogram(tmp_path: Path, commands: Commands):
    save_machine(HOIST, tmp_path / "machine.yaml")
    words = ("serve", tmp_path / "machine.yaml", "--port", 0, "--for", 0.2, "--status", tmp_path / "status.json")
    done = commands(*words)
    assert done.status == 0 and "on time" in done.out and "reached from this computer only" in done.err
    assert json.loads((tmp_path / "status.json").read_text())["pace"]["steps"] > 10


@pytest.mark.parametrize(
    ("wish", "said"),
    [
        (Wish(rate_hz=0.0), "expected 1 to 20000 Hz"),
        (Wish(watchdog_s=float("nan")), "more than 0"),
        (Wish(protocol="modbus", lock_step=True), "takes the protocol udp"),
    ],
)
def test_a_wish_that_cannot_be_is_refused(wish: Wish, said: str):
    with pytest.raises(InputError, match=said):
        wish.check()


def stepped(served: Served) -> None:
    """Waits for the plant's first step: on a busy computer its thread may come late."""
    ends = time.monotonic() + 20.0
    while served.session.plant.time_s == 0.0:
        assert time.monotonic() < ends
        time.sleep(0.005)


def test_pymodbus_own_client_reads_signals_and_sets_faults():
    pymodbus = pytest.importorskip("pymodbus.client")
    kind = pymodbus.ModbusTcpClient.DATATYPE.FLOAT32
    with Served(HOIST, protocol="modbus", watchdog_s=5.0) as served:
        client = pymodbus.ModbusTcpClient("127.0.0.1", port=served.port)
        assert client.connect()
        hold = served.session.plant.hold
        write = client.convert_to_registers(hold, kind)
        assert not client.write_registers(0, write).isError()
        stepped(served)
        assert not client.write_registers(2, client.convert_to_registers(6000.0, kind)).isError()
        assert not client.write_coil(1, True).isError()  # one motor lost
        numbers = client.convert_from_registers(client.read_input_registers(0, count=24).registers, kind)
        assert numbers[0] > 0.0 and numbers[4] == pytest.approx(9.0, abs=0.5)  # time, height
        assert numbers[11] == 6000.0
        bits = client.read_discrete_inputs(0, count=len(FLAGS)).bits
        assert bits[1] and not bits[6]
        assert client.convert_from_registers(client.read_holding_registers(2, count=2).registers, kind) == 6000.0
        assert client.write_registers(2, client.convert_to_registers(float("nan"), kind)).isError()
        assert client.write_registers(3, [1]).isError()
        client.close()
    assert any("finite number" in line for line in served.said)


def test_asyncua_own_client_reads_signals_and_sets_faults():
    asyncua = pytest.importorskip("asyncua.sync")
    from asyncua import ua

    with Served(HOIST, protocol="opcua", watchdog_s=5.0) as served:
        client = asyncua.Client(f"opc.tcp://127.0.0.1:{served.port}/")
        client.connect()
        try:
            space = client.get_namespace_index("urn:workbench:plant")

            def node(name: str) -> Any:
                return client.get_node(ua.NodeId(f"Plant.{name}", space))

            node("Inputs.torque_motor_nm").write_value(served.session.plant.hold)
            stepped(served)
            node("Inputs.payload_kg").write_value(6000.0)
            node("Inputs.motor_lost").write_value(True)
            assert node("Outputs.time_s").read_value() > 0.0
            assert node("Outputs.payload_now_kg").read_value() == 6000.0
            assert node("Outputs.is_motor_lost").read_value() is True
            assert "carriage height" in node("Outputs.position_carriage_m").read_description().Text
            with pytest.raises(ua.UaError):
                node("Inputs.payload_kg").write_value(-1.0)
            assert node("Inputs.payload_kg").read_value() == 6000.0
        finally:
            client.disconnect()
