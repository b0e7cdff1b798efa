"""What a served plant keeps to, whatever is sent: its loop goes on, its numbers stay physical, one client controls."""

from __future__ import annotations

import math
import socket
import struct
import time
from pathlib import Path
from typing import Any

import pytest

from benchmarks.attack.packets import attack
from benchmarks.serve import Client, Served, command_packet
from tests.serve.test_serve import BITS, HOIST, Hand
from tests.support.commands import Commands
from workbench.core.errors import InputError
from workbench.machines import save_machine
from workbench.serve import tcp
from workbench.serve.plant import LivePlant
from workbench.serve.serve import Wish
from workbench.serve.session import MOST_BEHIND_S, Session
from workbench.serve.udp import BYTE_ORDER, SILENT_S

TOKEN = "winch-7-bench"


def session_of(payload_kg: float = 4500.0, clock: Hand | None = None, said: list[str] | None = None) -> Session:
    plant = LivePlant(HOIST, 0.001, payload_kg, 9.0, ["friction_viscous"])
    return Session(plant, 0.001, 0.1, clock=clock or Hand(), say=(said if said is not None else []).append)


@pytest.mark.parametrize("protocol", ["udp", "modbus", "opcua"])
def test_no_packet_ends_the_loop_or_shows_what_is_no_number(protocol: str, capfd: pytest.CaptureFixture[str]):
    """Nor is there more than one line of a kind in five seconds; and no library prints a traceback."""
    pytest.importorskip("asyncua" if protocol == "opcua" else "socket")
    found = attack(protocol, {"udp": 1200, "modbus": 600, "opcua": 150}[protocol], seed=3)
    assert found["broken"] == {} and sum(found["refused"].values()) > 50
    shown = capfd.readouterr()
    assert "Traceback" not in shown.out + shown.err


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("payload_kg", 10**309), ("payload_kg", 1e300), ("payload_kg", 1e6), ("payload_kg", math.nan),
        ("slack_m", 1e9), ("slack_m", -0.1), ("brake_late_s", 1e308), ("brake_late_s", 60.0),
        ("torque_motor_nm", 1e308), ("torque_motor_nm", -(10**400)),
        ("effects.friction_viscous.viscous_n_s_per_m", 1e12), ("motor_lost", 10**400),
    ],
)  # fmt: skip
def test_a_number_beyond_what_the_machine_can_bear_changes_nothing(name: str, value: float):
    session = session_of()
    before = {point.name: point.read(session) for point in session.inputs}
    with pytest.raises(InputError, match="expected"):
        session.order({"set": {"slack_m": 0.1, name: value}})
    assert {point.name: point.read(session) for point in session.inputs} == before


def test_whatever_is_taken_leaves_the_plant_finite():
    """The ends of every range, all at once and one by one, a second each."""
    for which in [*range(len(session_of().inputs)), None]:
        for end in ("lowest", "highest"):
            session = session_of()
            for point in session.inputs if which is None else [session.inputs[which]]:
                if point.kind == "number":
                    session.set({point.name: getattr(point, end)})
            for _ in range(300):
                session.command(session.asked)
                session.step()
            assert all(math.isfinite(point.read(session)) for point in session.outputs), (which, end)


def test_a_packet_of_the_other_byte_order_moves_nothing():
    with Served(HOIST, watchdog_s=5.0) as served:
        client = Client(served.port)
        client.send(700.0)
        client.receive()
        client.send_bytes(struct.pack(">4sIIId16s", b"WBC2", BYTE_ORDER, 2, 0, 500.0, b""))
        assert client.order({"get": ["torque_motor_nm"]})["get"]["torque_motor_nm"] == 700.0
        assert served.session.counts["refused_byte_order"] == 1
        client.close()


def test_a_second_client_reads_only_and_is_told_so_until_the_first_is_silent():
    with Served(HOIST, watchdog_s=1.0) as served:
        first, second = Client(served.port), Client(served.port)
        first.send(served.session.plant.hold)
        first.receive()
        for order in ({"torque_motor_nm": 0.0}, {"reset": 1}, {"payload_kg": 0.0}):
            assert "read only: 127.0.0.1" in second.order({"set": order})["error"]
        second.send(0.0)
        assert "read only" in second.answer()["error"]
        assert second.order({"get": ["payload_kg"]})["get"] == {"payload_kg": 4500.0}
        assert first.order({"get": ["torque_motor_nm"]})["get"]["torque_motor_nm"] == served.session.plant.hold
        ends = time.monotonic() + 20.0
        while not served.session.silent and time.monotonic() < ends:
            time.sleep(0.02)
        assert second.order({"set": {"payload_kg": 100.0}}) == {"set": ["payload_kg"]}
        first.close()
        second.close()


def test_states_stop_a_second_after_the_last_command():
    with Served(HOIST, watchdog_s=30.0) as served:
        client = Client(served.port)
        client.send(served.session.plant.hold)
        begun = last = time.monotonic()
        client._line.settimeout(SILENT_S + 2.0)
        try:
            while time.monotonic() - begun < 30.0:
                client.receive()
                last = time.monotonic()
        except TimeoutError:
            pass
        assert 0.5 * SILENT_S < last - begun < SILENT_S + 1.0
        client.close()


def test_other_addresses_ask_for_a_token(tmp_path: Path, commands: Commands):
    save_machine(HOIST, tmp_path / "machine.yaml")
    for address in ("0.0.0.0", "::", "192.0.2.1", "plant.example"):
        done = commands("serve", tmp_path / "machine.yaml", "--address", address)
        assert done.status == 2 and "give a token" in done.err
    Wish(address="0.0.0.0", token=TOKEN).check()
    with pytest.raises(InputError, match="8 to 16 printable"):
        Wish(token="short").check()


def test_without_the_token_there_is_no_answer_at_all():
    with Served(HOIST, watchdog_s=5.0, token=TOKEN) as served:
        stranger, client = Client(served.port, "winch-8-bench"), Client(served.port, TOKEN)
        for data in (command_packet(1, 0.0), b'{"status": true}', b"{", b'{"token": 7, "get": []}'):
            stranger.send_bytes(data)
        stranger.send(0.0)
        client.send(served.session.plant.hold)
        assert client.receive().time_s > 0.0 and "status" in client.order({"status": True})
        stranger._line.settimeout(0.3)
        with pytest.raises(TimeoutError):
            stranger._line.recv(100)
        assert served.session.counts["refused_token"] == 5
        stranger.close()
        client.close()


def test_time_that_was_left_out_is_flagged_and_counted():
    clock = Hand()
    session = session_of(clock=clock)
    session.pace.begin(0.0)
    session.pace.start(5.0)  # before the first command: time does not run yet
    session.command(session.plant.hold)
    session.pace.end(5.0)
    assert not session.flags & BITS["skipped"]
    session.pace.start(session.pace.due_s + MOST_BEHIND_S + 3.0)
    assert session.flags & BITS["skipped"] and session.skipped_s == pytest.approx(3.0)
    assert session.order({"get": ["skipped_s", "is_skipped"]})["get"] == pytest.approx(
        {"skipped_s": 3.0, "is_skipped": 1}
    )
    session.set({"reset": 1})
    session.command(session.plant.hold)
    assert not session.flags & BITS["skipped"]


def test_a_wire_that_carries_more_than_its_breaking_load_is_told_until_reset():
    said: list[str] = []
    session, breaks_at = session_of(9000.0, said=said), HOIST.wire.breaking_load_n
    assert breaks_at is not None
    largest = 0.0
    for k in range(1500):
        if k == 100:
            assert not session.flags & BITS["overload"]
            session.set({"slack_m": 3.0})  # the carriage falls until the wire catches it
        session.command(session.plant.hold)
        session.step()
        largest = max(largest, session.plant.signal("tension_drum_n"), session.plant.signal("tension_dead_line_n"))
        assert bool(session.flags & BITS["overload"]) == (largest > breaks_at), k
    assert largest > breaks_at and any("breaking load" in line for line in said)
    session.set({"reset": 1})
    assert not session.flags & BITS["overload"]


# The gate before Modbus and OPC UA.


def closed(line: socket.socket, within_s: float = 10.0) -> bool:
    line.settimeout(within_s)
    try:
        return line.recv(100) == b""
    except ConnectionError:
        return True


def test_idle_connections_are_closed_and_the_33rd_is_not_let_in(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(tcp, "IDLE_S", 1.5)
    with Served(HOIST, protocol="modbus", watchdog_s=5.0) as served:
        lines = [socket.create_connection(("127.0.0.1", served.port)) for _ in range(tcp.MOST_CLIENTS)]
        time.sleep(0.2)
        with socket.create_connection(("127.0.0.1", served.port)) as one_more:
            assert closed(one_more, 1.0)
        assert all(closed(line) for line in lines)
        assert served.session.counts["idle_closed"] == tcp.MOST_CLIENTS
        assert served.session.counts["refused_connection"] == 1
        for line in lines:
            line.close()
        with socket.create_connection(("127.0.0.1", served.port)) as line:
            line.sendall(struct.pack(">HHHBBHH", 1, 0, 6, 1, 4, 0, 2))
            assert len(line.recv(100)) == 13


def test_a_modbus_client_reads_only_while_another_controls():
    pymodbus = pytest.importorskip("pymodbus.client")
    kind = pymodbus.ModbusTcpClient.DATATYPE.FLOAT32
    with Served(HOIST, protocol="modbus", watchdog_s=5.0) as served:
        first, second = (pymodbus.ModbusTcpClient("127.0.0.1", port=served.port) for _ in range(2))
        assert first.connect() and second.connect()
        hold = first.convert_to_registers(served.session.plant.hold, kind)
        assert not first.write_registers(0, hold).isError()
        refused = second.write_registers(0, hold)
        assert refused.isError() and refused.exception_code == 6
        assert second.write_coil(2, True).exception_code == 6
        assert not second.read_input_registers(0, count=2).isError()
        first.close()
        second.close()


def test_a_modbus_client_shows_the_token_in_its_registers():
    pymodbus = pytest.importorskip("pymodbus.client")
    with Served(HOIST, protocol="modbus", watchdog_s=5.0, token=TOKEN) as served:
        client = pymodbus.ModbusTcpClient("127.0.0.1", port=served.port)
        assert client.connect()
        assert client.read_input_registers(0, count=2).isError()
        for token, let_in in (("winch-8-bench", False), (TOKEN, True)):
            words = list(struct.unpack(">8H", token.encode().ljust(16, b"\0")))
            assert client.write_registers(60000, words).isError() != let_in
            assert client.read_input_registers(0, count=2).isError() != let_in
        client.close()


def test_the_endpoint_is_told_when_it_listens_and_one_session_writes():
    asyncua = pytest.importorskip("asyncua.sync")
    from asyncua import ua

    class Ear(list[str]):
        """Whoever reads the line connects at once."""

        def append(self, line: str) -> None:
            if line.startswith("Endpoint: opc.tcp://"):
                port = int(line.rpartition(":")[2].strip("/"))
                socket.create_connection(("127.0.0.1", port), timeout=5.0).close()
            super().append(line)

    with Served(HOIST, Ear(), protocol="opcua", watchdog_s=5.0, token=TOKEN) as served:
        assert any(line.startswith("Endpoint:") for line in served.said)
        url = f"opc.tcp://127.0.0.1:{served.port}/"

        def client(token: str) -> Any:
            made = asyncua.Client(url)
            made.set_user("anybody")
            made.set_password(token)
            return made

        stranger = client("winch-8-bench")
        with pytest.raises(ua.UaError):
            stranger.connect()
        stranger.tloop.stop()  # asyncua's own thread, which a failed connection leaves
        first, second = client(TOKEN), client(TOKEN)
        first.connect()
        second.connect()
        try:
            at = ua.NodeId("Plant.Inputs.torque_motor_nm", first.get_namespace_index("urn:workbench:plant"))
            first.get_node(at).write_value(served.session.plant.hold)
            with pytest.raises(ua.UaStatusCodeError, match="BadUserAccessDenied"):
                second.get_node(at).write_value(0.0)
            assert second.get_node(at).read_value() == served.session.plant.hold
        finally:
            first.disconnect()
            second.disconnect()
