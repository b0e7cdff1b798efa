"""The watch: the test's false alarms, what raises an alarm and what does not, and a state that counts a cycle once."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from functools import cache
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import numpy as np
import pytest

from benchmarks.attack.watch_states import put
from benchmarks.sequences import axis_cycle
from benchmarks.watch import friction_grows, healthy, month, sensor_drifts
from tests.support.effect_machines import linear_axis
from tests.watch.test_state import counted
from workbench.core.errors import InputError
from workbench.core.run import Run
from workbench.machines import default_hoist, save_machine, with_values
from workbench.watch.cause import Cause, groups_of, likelihoods, posterior
from workbench.watch.estimate import Estimate, estimate, learn, watched_keys
from workbench.watch.judge import LOAD, Cycle, Judge, Rules, trend
from workbench.watch.store import Store, digest_of
from workbench.watch.watch import Watch

HOIST = default_hoist()
KEYS = watched_keys(HOIST)
FEW = Rules(cycles_between=1000.0, healthy=60)


# The estimate.


def test_the_estimates_are_the_true_values_within_their_errors_where_the_cycle_shows_them():
    true = with_values(HOIST, {"guide.coulomb_hoisting_n": 7000.0, "guide.coulomb_lowering_n": 5250.0})
    made = [estimate(HOIST, run) for run, _ in month(true, 6, healthy, 3)]
    total = np.mean([e.values[0] + e.values[1] for e in made])
    assert total == pytest.approx(12_250.0, rel=0.01)
    assert np.all(np.abs(np.mean([e.values for e in made], axis=0)[2:] - [8000.0, 0.8, 0.0]) < [40.0, 0.01, 3.0])
    assert made[0].resolution.shape == (5, 5)
    both = made[0].resolution[:2, :2].sum()
    assert both == pytest.approx(2.0, abs=0.05)  # friction both ways is seen whole


# The test of a change.


def test_other_healthy_machines_alarm_at_the_stated_rate():
    """With every alarm the state that explains it becomes the baseline, so all that follows an alarm counts too."""
    cycles_between, machines, count = 100.0, 16, 400
    rules = Rules(cycles_between=cycles_between, healthy=40)
    alarms = 0
    for seed in range(machines):
        made = [Judge(rules)]
        alarms += sum(made[0].add(cycle).alarm is not None and not made[0].alarms[-1].again
                      for cycle in cycles(40 + count, seed=seed))  # fmt: skip
    expected = machines * count / cycles_between
    # Machines differ by the luck of their baselines: the count scatters more than Poisson's.
    assert abs(alarms - expected) < 3.0 * np.sqrt(2.5 * expected)


def test_a_shift_of_two_sigma_is_found_within_ten_cycles_with_its_beginning():
    judge = judged(Rules(healthy=100), cycles(200, {120: np.array([0.0, 0.0, 10.0, 0.0, 0.0])}, seed=1))
    first = judge.alarms[0]
    assert 120 <= first.cycle < 130 and abs(first.onset - 120) <= 4


def test_a_line_meets_its_limit_when_it_says():
    rng = np.random.default_rng(3)
    goes = trend([2.0 * k + rng.normal() for k in range(50)], 150.0)
    assert goes is not None and goes.left is not None and goes.left_ci95 is not None
    assert goes.left == pytest.approx(26.0, abs=1.5) and goes.left_ci95[0] < 26.0 < goes.left_ci95[1]
    level = trend(list(rng.normal(size=50)), 150.0)
    assert level is not None and level.left is None
    assert trend([1.0, 2.0], 5.0) is None


# The judge, on estimates made directly: fast, and any change at will.


def cycles(
    count: int, changes: dict[int, np.ndarray] | None = None, payload: float = 4500.0, seed: int = 4
) -> list[Cycle]:
    """Cycles whose estimates scatter around zero; changes: added from that cycle on."""
    rng = np.random.default_rng(seed)
    sizes = np.array([60.0, 60.0, 5.0, 0.001, 0.5])
    made, added = [], np.zeros(5)
    for k in range(count):
        added = (changes or {}).get(k, added)
        values = sizes * rng.normal(size=5) + added
        made.append(Cycle(f"c{k}", payload, 100.0 * k, 20.0, Estimate(KEYS, values, sizes, np.eye(5), 1.0, 1.0)))
    return made


def judged(rules: Rules, given: list[Cycle]) -> Judge:
    judge = Judge(rules)
    for cycle in given:
        judge.add(cycle)
    return judge


def test_a_change_is_named_by_the_parameters_that_explain_it():
    judge = judged(FEW, cycles(120, {80: np.array([150.0, 150.0, 0.0, 0.0, 0.0])}))
    alarm = judge.alarms[0]
    assert 80 <= alarm.cycle < 90 and abs(alarm.onset - 80) <= 4
    assert alarm.causes[0].name == "friction both ways" and alarm.causes[0].share > 0.7
    assert alarm.causes[0].amount == pytest.approx(150.0, rel=0.4)


def test_a_change_that_goes_on_is_one_alarm_and_is_told_again_as_it_grows():
    grows = {80 + k: np.array([0.0, 0.0, 0.0, 0.0002 * k, 0.0]) for k in range(100)}
    judge = Judge(FEW)
    made = [judge.add(c) for c in cycles(180, grows)]
    alarms = [judged for judged in made if judged.alarm is not None]
    assert len(alarms) > 3 and sum(not judged.again for judged in alarms) == 1
    assert judge.baseline is not None and judge.baseline.count in (60, 120)  # it does not learn the fault


def test_a_second_different_change_has_its_own_alarm_and_name_while_the_first_goes_on():
    drift = {150 + k: np.array([8.0 * k, 8.0 * k, 0.0, 0.0, 0.0]) for k in range(150)}
    both = {300 + k: np.array([1200.0 + 8.0 * k, 1200.0 + 8.0 * k, 0.0, 0.0, 2.0]) for k in range(100)}
    judge = judged(Rules(healthy=100), cycles(400, drift | both))
    first, second = (alarm for alarm in judge.alarms if not alarm.again)
    grown = [alarm for alarm in judge.alarms if alarm.again and alarm.onset == first.onset]
    assert 150 <= first.cycle <= 175 and grown[-1].causes[0].name == "friction both ways"
    assert 300 <= second.cycle <= 310 and second.causes[0].name == "torque offset"
    assert second.causes[0].amount == pytest.approx(2.0, rel=0.4)
    nominal = dict.fromkeys(KEYS, 0.0)
    goes = judge.trend_of(first, nominal)
    assert goes is not None and goes.rate == pytest.approx(8.0, rel=0.1)  # the drift is estimated through both
    later = judge.trend_of(second, nominal)
    assert later is not None and later.now == pytest.approx(2.0, abs=0.4) and abs(later.rate) < 0.02


def test_cycles_after_a_long_rest_do_not_count_until_it_is_warm():
    warm = np.array([400.0, 400.0, 0.0, 0.0, 0.0])
    given = cycles(120, {80: warm, 85: np.zeros(5)})
    late = [Cycle(c.name, c.payload_kg, c.start_s + (50_000.0 if i >= 80 else 0.0), 20.0, c.estimate)
            for i, c in enumerate(given)]  # fmt: skip
    rules = Rules(cycles_between=1000.0, healthy=60, pause_s=3600.0, warm_up_s=480.0)
    judge = Judge(rules)
    events = [event for c in late for event in judge.add(c).events]
    assert not judge.alarms
    assert [event.cycle for event in events if event.kind == "warm_up"] == [0, 80]
    assert judged(FEW, late).alarms  # without the rule it is an alarm


def test_a_new_payload_is_an_event_and_friction_is_watched_on():
    given = cycles(80)
    heavier = np.array([0.0, 0.0, 60.0, 0.0, 0.0])
    other = cycles(40, {0: heavier, 20: heavier + np.array([250.0, 250.0, 0.0, 0.0, 0.0])}, payload=7000.0, seed=2)
    judge = Judge(FEW)
    events = [event for c in [*given, *other] for event in judge.add(c).events]
    assert [event.kind for event in events].count("payload") == 1
    assert judge.alarms and judge.alarms[0].cycle >= 100
    assert judged(FEW, [*given, *cycles(20, {0: heavier}, seed=2)]).alarms  # the same at a stated old payload alarms


def test_one_wild_cycle_is_an_event_two_are_an_alarm():
    wild = np.array([900.0, 900.0, 0.0, 0.0, 0.0])
    once, twice = cycles(100, {80: wild, 81: np.zeros(5)}), cycles(100, {80: wild, 82: np.zeros(5)})
    judge = Judge(FEW)
    events = [event for c in once for event in judge.add(c).events]
    assert "single" in [event.kind for event in events] and not judge.alarms
    assert judged(FEW, twice).alarms


def test_an_axis_shows_friction_and_a_constant_load_as_two_directions():
    axis = linear_axis(backward=20.0, constant=0.0)
    rng = np.random.default_rng(5)
    machines = [axis] * 40 + [with_values(axis, {"gravity.constant_n": 3.0})] * 6
    judge = Judge(Rules(healthy=40))
    for k, machine in enumerate(machines):
        run = axis_cycle(machine, rng)
        judge.add(Cycle(run.name, 0.0, 60.0 * k, run.duration_s, estimate(axis, run)))
    assert judge.baseline is not None
    assert judge.baseline.line[0] == pytest.approx([95.0, 200.0, 20.0, 20.0], rel=0.05)
    assert judge.alarms[0].cycle in (40, 41)
    first = judge.alarms[-1].causes[0]
    assert first.name == "constant load or offset" and first.share > 0.9
    assert first.amount == pytest.approx(3.0, rel=0.1)
    nominal = dict(zip(watched_keys(axis), judge.baseline.line[0], strict=True))
    assert judge.rules.limits == {} and judge.trend_of(judge.alarms[0], nominal) is not None


# A short month of real logs.


@cache
def logs(kind: str) -> tuple[Run, ...]:
    change = {"friction": friction_grows(70, 60), "drift": sensor_drifts(70, 0.2), "healthy": healthy}[kind]
    return tuple(run for run, _ in month(HOIST, 100, change, 6))


@pytest.mark.parametrize(
    ("kind", "names"), [("friction", {"friction both ways"}), ("drift", {"torque offset", "mass"})]
)
def test_faults_of_simulated_months_raise_an_alarm_soon(kind: str, names: set[str]):
    judge = Judge(FEW)
    for k, run in enumerate(logs(kind)):
        judge.add(Cycle(run.name, run.payload_kg, 69.0 * k, run.duration_s, estimate(HOIST, run)))
    assert judge.alarms and 70 <= judge.alarms[0].cycle <= 90
    assert judge.alarms[0].causes[0].name in names


@pytest.mark.parametrize(
    ("true", "offset_nm", "wire_kg_per_m"), [("torque_offset", 12.0, 0.0), ("wire_mass", 0.0, 9.0)]
)
def test_causes_that_look_alike_are_told_apart_beside_the_healthy_cycles(true, offset_nm, wire_kg_per_m):
    healthy_ones = [estimate(HOIST, run) for run in logs("healthy")]
    payloads = np.array([run.payload_kg for run in logs("healthy")])
    mean = np.mean([made.resolution for made in healthy_ones], axis=0)
    baseline = learn(np.array([made.values for made in healthy_ones]), payloads, mean[:, KEYS.index(LOAD)], KEYS)
    effects = {"torque_offset": {"offset_nm": offset_nm}, "wire_mass": {"mass_kg_per_m": wire_kg_per_m}}
    runs = [run for run, _ in month(HOIST, 24, lambda k: ({}, {true: effects[true]}), 9)]
    since = [Cycle(run.name, run.payload_kg, 0.0, 9.0, estimate(HOIST, run)) for run in runs]
    causes = {
        name: Cause(HOIST.model_copy(update={"effects": {name: values}}))
        for name, values in {
            "torque_offset": {"offset_nm": 12.0},
            "wire_mass": {"mass_kg_per_m": 9.0},
            "carriage_mass_error": {"mass_kg": 245.0},
        }.items()
    }
    logs_of = likelihoods(HOIST, causes, groups_of(since, runs, baseline), baseline)
    after = posterior(dict.fromkeys(causes, 0.3), logs_of)
    assert max(after, key=lambda name: after[name]) == true and after[true] > 0.85
    assert sum(after.values()) == pytest.approx(0.9)


# The folder and the state.


@pytest.fixture(scope="module")
def arrived(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A machine and 100 logs of it, friction growing from the seventieth on."""
    place = tmp_path_factory.mktemp("arrived")
    save_machine(HOIST, place / "machine.yaml")
    for k, run in enumerate(logs("friction")):
        put(place / "logs", run, 69.0 * k)
    return place


def watch_of(place: Path, state: Path, **more: object) -> Watch:
    return Watch(place / "logs", HOIST, state, FEW, settle_s=0.0, **more)  # type: ignore[arg-type]


def words(place: Path, state: Path, *more: object) -> list[object]:
    files = "--machine", place / "machine.yaml", "--state", state
    return ["watch", place / "logs", *files, "--once", "--settle", "0.05",
            "--healthy", "60", "--skip-diagnosis", *more]  # fmt: skip


def test_the_command_alarms_by_its_exit_status_and_counts_nothing_twice(arrived, tmp_path, commands):
    state = tmp_path / "state"
    first = commands(*words(arrived, state, "--limit", "guide.coulomb_hoisting_n=9000"))
    assert first.status == 1, first.err
    assert "ALARM at cycle_0007" in first.err and "friction both ways" in first.out
    shutil.copy(arrived / "logs" / "cycle_00003.csv", arrived / "logs" / "again.csv")
    shutil.copy(arrived / "logs" / "cycle_00003.csv.yaml", arrived / "logs" / "again.csv.yaml")
    again = commands(*words(arrived, state))
    assert again.status == 0 and "ALARM" not in again.err
    import duckdb

    with duckdb.connect() as db:
        assert db.execute(f"SELECT count(*), max(cycle) FROM '{state}/cycles.parquet'").fetchall() == [(100, 99)]
        assert db.execute(f"SELECT count(*) FROM '{state}/alarms.parquet' WHERE NOT again").fetchall() == [(1,)]
    page = (state / "watch.html").read_text(encoding="utf-8")
    assert "friction both ways" in page and "Test of a change" in page


def test_after_kill_9_it_goes_on_where_it_was(arrived: Path, tmp_path: Path):
    state = tmp_path / "state"
    line = [sys.executable, "-m", "workbench", *map(str, words(arrived, state))]
    process = subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    ends = time.monotonic() + 120.0
    while time.monotonic() < ends and process.poll() is None and counted(state) < 10:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    begun = counted(state)
    assert begun >= 10
    watch = watch_of(arrived, state)
    assert len(watch.judge.cycles) == begun
    new, _ = watch.look(0.0)
    alarms = watch.judge.alarms, watch.store.said()
    watch.close()
    whole = watch_of(arrived, tmp_path / "other")
    whole.look(0.0)
    assert begun + new == len(whole.judge.cycles)
    assert alarms == (whole.judge.alarms, whole.store.said())
    whole.close()


def test_a_log_that_is_being_written_is_waited_for_and_a_cut_one_is_said(tmp_path: Path):
    said: list[str] = []
    run = logs("healthy")[0]
    whole = put(tmp_path / "logs", run)
    text = whole.read_text()
    whole.write_text(text[: len(text) // 2])
    watch = Watch(tmp_path / "logs", HOIST, tmp_path / "state", FEW, settle_s=1.0, say=said.append)
    assert watch.look(0.0) == (0, 1)
    whole.write_text(text)
    assert watch.look(1.5) == (0, 1)  # it has changed since
    assert watch.look(2.6) == (1, 0)
    cut = put(tmp_path / "logs", logs("healthy")[1], 69.0)
    cut.write_text(cut.read_text()[:2000].rpartition(",")[0])
    bare = put(tmp_path / "logs", logs("healthy")[2], 138.0)
    bare.with_name(f"{bare.name}.yaml").unlink()
    watch.look(3.0)
    assert watch.look(4.5) == (0, 1)
    watch.close()
    assert any("not counted" in line and cut.name in line for line in said)
    assert any(f"{bare.name}: waits for its entry in runs.yaml" in line for line in said)
    assert not watch_of(tmp_path, tmp_path / "state").store.known(digest_of(bare))


def test_an_alarm_is_posted_and_posted_later_where_nobody_answered(arrived: Path, tmp_path: Path):
    got: list[dict[str, object]] = []

    class Hook(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            got.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(204)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    server = HTTPServer(("127.0.0.1", 0), Hook)
    address = f"http://127.0.0.1:{server.server_port}/alarm"
    said: list[str] = []
    watch = watch_of(arrived, tmp_path / "state", hook="http://127.0.0.1:9/nobody", say=said.append)
    watch.look(0.0)
    watch.close()
    assert not got and any("it is tried again" in line for line in said)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    for _ in range(2):  # once only
        watch = watch_of(arrived, tmp_path / "state", hook=address, diagnose=lambda campaign, *rest: {
            "verdict": "named", "effects": ["friction_coulomb"], "sentence": f"{len(campaign.runs)} runs"})  # fmt: skip
        watch.look(0.0)
        watch.close()
    server.shutdown()
    server.server_close()
    assert len(got) == 1 and "friction both ways" in str(got[0]["sentence"])
    assert "runs" in str(got[0]["diagnosis"]) and got[0]["machine"] == HOIST.name


def test_a_state_of_another_machine_or_of_other_rules_is_refused(tmp_path: Path):
    Store(tmp_path, HOIST, FEW).close()
    Store(tmp_path, HOIST, Rules(1000.0, 60, limits={"carriage.mass_kg": 9000.0})).close()
    with pytest.raises(InputError, match="another machine"):
        Store(tmp_path, with_values(HOIST, {"carriage.mass_kg": 8100.0}), FEW)
    with pytest.raises(InputError, match="another healthy"):
        Store(tmp_path, HOIST, Rules(1000.0, 50))
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "watch.sqlite").write_text("no store" * 100)
    with pytest.raises(InputError, match="file is not a database"):
        Store(tmp_path / "bad", HOIST, FEW)
