"""A stream of values cut into cycles, a server that comes and goes, a fleet of machines."""

from __future__ import annotations

import math
import re
import shutil
import socket
import sqlite3
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks.attack.watch_states import HOIST, RULES, make_state, put, short_runs
from benchmarks.watch import healthy, month
from tests.support.commands import Commands
from tests.support.opcua_machine import OpcUaMachine
from workbench.core.errors import InputError
from workbench.core.run import Run
from workbench.machines import default_hoist, save_machine
from workbench.watch.estimate import estimate
from workbench.watch.judge import Rules
from workbench.watch.opcua import (
    TRIGGER,
    Cut,
    CutRules,
    Cutter,
    Line,
    nodes_of,
    on_grid,
    still_speed,
    with_payload,
)
from workbench.watch.watch import Watch

MACHINE = default_hoist()
CUT = CutRules("speed", still=0.1, stand_s=1.0, silent_s=1.0)
DT = 0.02
NODES = """nodes:
  torque_motor_nm: ns=2;s=Drive.torque_motor_nm
  speed_motor_rad_s: ns=2;s=Drive.speed_motor_rad_s
  payload_kg: ns=2;s=Drive.payload_kg
start_position_m: 9.0
"""


# Where a cycle begins and ends.


def speed_at(t: float) -> float:
    """Two moves of a second, a dwell of half a second between: from 2.0 to 4.5, every 6 s."""
    t = t % 6.0
    return math.sin(math.pi * (t - 2.0)) * (2.0 < t < 3.0) - math.sin(math.pi * (t - 3.5)) * (3.5 < t < 4.5)


def play(
    cutter: Cutter,
    begin: float,
    end: float,
    *,
    speed: Callable[[float], float] = speed_at,
    clock: float = 1000.0,
    late: Callable[[float], float] = lambda t: 0.0,
) -> None:
    for k in range(round(begin / DT), round(end / DT)):
        t = k * DT
        cutter.add("speed", clock + t, speed(t), t + late(t))
        cutter.add("torque", clock + t, 10.0 * speed(t), t + late(t))
    cutter.tick(t + late(t))


def test_a_cycle_lies_between_two_stands_and_a_dwell_is_part_of_it():
    cutter = Cutter(CUT)
    play(cutter, 0.0, 18.0)
    assert not cutter.spoilt and len(cutter.cycles) == 3
    for k, cut in enumerate(cutter.cycles):
        assert cut.moves_s == pytest.approx((1002.0 + 6 * k, 1004.5 + 6 * k), abs=0.1)
        assert cut.begin_s == pytest.approx(cut.moves_s[0] - 0.5) and cut.end_s == pytest.approx(cut.moves_s[1] + 0.5)
        time_s, signals = on_grid(cut, "speed")
        assert np.diff(time_s) == pytest.approx(DT) and time_s[0] == 0.0
        expected = [speed_at(t) for t in time_s + cut.begin_s - 1000.0]
        assert signals["speed"] == pytest.approx(expected, abs=0.04) and signals["torque"] == pytest.approx(
            10.0 * np.array(expected), abs=0.4
        )


def test_a_stream_that_begins_in_a_motion_waits_for_a_stand():
    cutter = Cutter(CUT)
    play(cutter, 2.4, 11.9)
    assert [round(cut.moves_s[0] - 1008.0) for cut in cutter.cycles] == [0]


@pytest.mark.parametrize("late", [0.0, 0.7])
def test_a_stream_that_stops_in_a_motion_spoils_that_cycle_only(late: float):
    cutter = Cutter(CUT)
    play(cutter, 0.0, 2.5, late=lambda t: late)
    for t in (2.6, 3.0, 5.0, 8.0):
        cutter.tick(t + late)
    play(cutter, 9.0, 17.9, late=lambda t: late)
    assert [bad.in_cycle for bad in cutter.spoilt] == [True] and "no value came" in cutter.spoilt[0].reason
    assert [round(cut.moves_s[0]) for cut in cutter.cycles] == [1014]


@pytest.mark.parametrize(("jump", "word"), [(-3600.0, "back"), (3600.0, "ahead"), (-5.0, "back"), (5.0, "ahead")])
def test_a_clock_that_jumps_in_a_cycle_spoils_that_cycle_only(jump: float, word: str):
    cutter = Cutter(CUT)
    play(cutter, 0.0, 2.5)
    play(cutter, 2.5, 17.9, clock=1000.0 + jump)
    assert [(bad.in_cycle, word in bad.reason) for bad in cutter.spoilt] == [(True, True)]
    assert [round(cut.moves_s[0] - jump) for cut in cutter.cycles] == [1008, 1014]


def test_a_trigger_marks_cycles_by_its_edges():
    cutter = Cutter(CutRules("speed", still=0.1, stand_s=1.0, silent_s=1.0, triggered=True))
    last = math.nan
    for k in range(900):
        t = k * DT
        if (high := float(80 <= k % 300 < 250)) != last:
            cutter.add(TRIGGER, t, high, t)
            last = high
        cutter.add("speed", t, speed_at(t), t)
        cutter.tick(t)
    assert [cut.moves_s for cut in cutter.cycles] == [pytest.approx((1.6 + 6 * k, 5.0 + 6 * k)) for k in range(3)]


# What is written.


def cut_with(payload: list[tuple[float, float]]) -> Cut:
    speed = [(k * DT, speed_at(k * DT)) for k in range(300)]
    return Cut(1.5, 5.0, (2.0, 4.5), {"speed": np.array(speed), "payload_kg": np.array(payload)})


def test_a_payload_picked_up_before_the_move_shortens_the_stand_and_one_changed_in_it_spoils_the_cycle():
    cut, payload = with_payload(cut_with([(-9.0, 0.0), (1.8, 4500.0), (4.7, 0.0)]), "payload_kg")
    assert payload == 4500.0 and (cut.begin_s, cut.end_s) == (1.8, 4.7)
    with pytest.raises(InputError, match="changed from 0 to 4500 kg"):
        with_payload(cut_with([(-9.0, 0.0), (3.0, 4500.0)]), "payload_kg")
    with pytest.raises(InputError, match="is nan, expected kg"):
        with_payload(cut_with([(-9.0, math.nan)]), "payload_kg")


# A server that is not ours.


@cache
def runs(count: int) -> tuple[Run, ...]:
    return tuple(run for run, _ in month(MACHINE, count, healthy, 3))


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture(scope="module")
def machine() -> Iterator[OpcUaMachine]:
    made = OpcUaMachine(["torque_motor_nm", "speed_motor_rad_s", "payload_kg"], free_port(), rate=8.0)
    yield made
    made.down()


def watch_of(place: Path, machine: OpcUaMachine, said: list[str]) -> tuple[Watch, Line]:
    (place / "nodes.yaml").write_text(NODES)
    nodes = nodes_of(place / "nodes.yaml", MACHINE)
    rules = CutRules(nodes.motion, still_speed(MACHINE, None), silent_s=1e5, slip_s=1e5)
    line = Line(machine.address, nodes, rules, MACHINE, place / "stream", 0.01, clock=machine.clock)
    rule = Rules(healthy=60)
    return Watch(place / "stream", MACHINE, place / "state", rule, settle_s=0.0, line=line, say=said.append), line


def until(what: Callable[[], bool], said: list[str], seconds: float = 30.0) -> None:
    ends = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < ends, said
        time.sleep(0.05)


def test_cycles_of_a_server_are_those_of_its_logs_and_a_server_that_goes_and_comes_spoils_one(machine, tmp_path):
    whole, said = runs(3), list[str]()
    watch, line = watch_of(tmp_path, machine, said)
    stand = 4.0 / machine.rate

    def played(run: Run, **more: Callable[[float], bool]) -> None:
        machine.put({"payload_kg": run.payload_kg}, machine.clock())
        time.sleep(stand)
        machine.play(run, {}, **more)

    line.start()
    played(whole[0])
    until(lambda: watch.look(0.0)[0] == 1, said)
    played(whole[1], until=lambda t: t > 3.0)
    machine.down()
    until(lambda: bool(watch.look(0.0)) and any("the line is lost" in text for text in said), said)
    machine.put({"speed_motor_rad_s": 0.0}, machine.clock())
    machine.up()
    until(lambda: bool(watch.look(0.0)) and any("the line is back" in text for text in said), said)
    played(whole[2])
    until(lambda: watch.look(0.0)[0] == 1, said)
    line.close()
    kept = watch.store.cycles()
    watch.close()
    assert [k.payload_kg for k in kept] == [whole[0].payload_kg, whole[2].payload_kg]
    for k, run in zip(kept, (whole[0], whole[2]), strict=True):
        alone = estimate(MACHINE, run)
        assert np.all(np.abs(k.estimate.values - alone.values) < 2.0 * alone.errors + 1e-9)
    assert sum("not counted" in text and "the line to the server was lost" in text for text in said) == 1

    again, idle = watch_of(tmp_path, machine, said)
    assert again.look(0.0) == (0, 0) and len(again.judge.cycles) == 2
    assert not idle.in_cycle
    again.close()


def test_what_a_stream_lacks_is_one_line(machine: OpcUaMachine, tmp_path: Path, commands: Commands):
    save_machine(MACHINE, tmp_path / "machine.yaml")
    nodes = tmp_path / "nodes.yaml"

    def said(text: str, *more: object, address: str = machine.address) -> str:
        nodes.write_text(text)
        where = "--machine", tmp_path / "machine.yaml", "--state", tmp_path / "state"
        done = commands("watch", address, *where, *more)
        assert done.status == 2 and len(done.err.strip().splitlines()) == 1
        return done.err

    named = "--nodes", nodes
    assert "no server answers" in said(NODES, *named, address=f"opc.tcp://127.0.0.1:{free_port()}")
    assert "did you mean 'ns=2;s=Drive.torque_motor_nm'" in said(NODES.replace("Drive.torque", "Drive.torq"), *named)
    assert "is no node, expected such as" in said(NODES.replace("ns=2;s=Drive.payload_kg", "payload"), *named)
    assert "has no namespace 'urn:workbench:plant'" in said(NODES)
    assert "did you mean 'torque_motor_nm'" in said(NODES.replace("  torque_motor_nm", "  torque_motor_n"), *named)
    without = "".join(line for line in NODES.splitlines(keepends=True) if "speed" not in line)
    assert "has no node for speed_motor_rad_s" in said(without, *named)
    assert "needs a node for position_carriage_m" in said(NODES.replace("start_position_m: 9.0\n", ""), *named)
    assert "a stream has no end" in said(NODES, *named, "--once")


# Many machines: one table by state, each with a state of its own, in one process and on workers.


DOCS = Path(__file__).resolve().parents[2] / "docs" / "watch.md"
FLEET = """\
machines:
  sick: {logs: logs/a, machine: machine.yaml}
  new: {logs: logs/b, machine: machine.yaml, limits: {carriage.mass_kg: 9000}}
  broken: {logs: logs/c, machine: machine.yaml}
"""


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine with an alarm that no call has told of and a new log, a new one with two logs, and a damaged state."""
    save_machine(HOIST, tmp_path / "machine.yaml")
    make_state(tmp_path / "state" / "sick")
    (tmp_path / "state" / "broken").mkdir()
    (tmp_path / "state" / "broken" / "watch.sqlite").write_bytes(b"no store" * 99)
    for folder, runs in (("a", short_runs(1)), ("b", short_runs(2)), ("c", ())):
        (tmp_path / "logs" / folder).mkdir(parents=True)
        for run in runs:
            put(tmp_path / "logs" / folder, run)
    (tmp_path / "fleet.yaml").write_text(FLEET)
    monkeypatch.chdir(tmp_path)
    return tmp_path


OPTIONS = "--state", "state", "--once", "--settle", 0.02, "--healthy", RULES.healthy, "--skip-diagnosis"


@pytest.mark.parametrize("cluster", [(), ("--cluster", "local:2")])
def test_one_table_by_state_and_a_broken_machine_keeps_nobody_from_being_watched(cluster, place, commands):
    done = commands("watch", "--fleet", "fleet.yaml", *OPTIONS, *cluster)
    assert done.status == 2 and "broken: state/broken/watch.sqlite: is damaged" in done.err.replace(f"{place}/", "")
    assert "Traceback" not in done.err and "3 machines: 1 failed, 1 alarm, 1 learning, 0 healthy." in done.out
    with sqlite3.connect("state/fleet.sqlite") as db:
        rows = db.execute("SELECT machine, state, cycles FROM machines").fetchall()
    assert rows == [("broken", "failed", 0), ("sick", "alarm", 61), ("new", "learning", 2)]
    shutil.rmtree("state/broken")
    assert commands("watch", "--fleet", "fleet.yaml", *OPTIONS).status == 1  # now the alarm is told of
    assert commands("watch", "--fleet", "fleet.yaml", *OPTIONS).status == 0


def test_the_documented_queries_give_machines_estimates_and_alarms(place: Path, commands: Commands):
    pd = pytest.importorskip("pandas", reason="allowed: pandas is not installed")
    shutil.rmtree("state/broken")
    assert commands("watch", "--fleet", "fleet.yaml", *OPTIONS).status == 1
    text = DOCS.read_text(encoding="utf-8")
    by_state, estimates = re.findall(r"```sql\n(.*?)```", text, re.DOTALL)
    with sqlite3.connect("state/fleet.sqlite") as db:
        assert db.execute(by_state).fetchone()[:3] == ("sick", "alarm", "friction both ways")
    with sqlite3.connect("state/sick/watch.sqlite") as db:
        rows = db.execute(estimates).fetchall()
    assert len(rows) == 5 * 61 and {metric for _, metric, _ in rows} >= {"carriage.mass_kg"}
    names: dict[str, object] = {}
    exec(re.findall(r"```python\n(.*?)```", text, re.DOTALL)[0], names)
    cycles, alarms, machines = (names[name] for name in ("cycles", "alarms", "machines"))
    assert isinstance(cycles, pd.DataFrame) and isinstance(alarms, pd.DataFrame) and isinstance(machines, pd.DataFrame)
    assert len(cycles.loc["sick"]) == 61 and len(cycles.loc["new"]) == 2 and len(machines) == 3
    ordered = cycles.loc["sick"].sort_values("start_s", kind="stable")
    mass = [value for _, metric, value in rows if metric == "carriage.mass_kg"]
    assert mass == pytest.approx(list(ordered["carriage.mass_kg"]))
    assert set(alarms.loc["sick"]["likeliest"]) == {"friction both ways"}


@pytest.mark.parametrize(
    ("text", "words", "said"),
    [
        ("machines: {}\n", (), "fleet.yaml"),
        (FLEET.replace("logs:", "log:"), (), "unknown key 'log'"),
        (FLEET, ("logs/a",), "takes the place of FOLDER"),
        (None, ("logs/a",), "FOLDER and --machine, or --fleet"),
    ],
)
def test_a_fleet_that_cannot_be_is_one_line(text, words, said, place, commands):
    (place / "fleet.yaml").write_text(text or "")
    given = ("--fleet", "fleet.yaml") if text is not None else ()
    done = commands("watch", *words, *given, *OPTIONS)
    assert done.status == 2 and said in done.err and len(done.err.strip().splitlines()) == 1
