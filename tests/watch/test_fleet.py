"""Many machines: one table by state, each with a state of its own, in one process and on workers."""

from __future__ import annotations

import re
import shutil
import sqlite3
from pathlib import Path

import pytest

from benchmarks.attack.watch_states import HOIST, RULES, make_state, put, short_runs
from tests.support.commands import Commands
from workbench.machines import save_machine

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
def test_one_table_by_state_and_a_broken_machine_keeps_nobody_from_being_watched(
    cluster: tuple[str, ...], place: Path, commands: Commands
):
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
def test_a_fleet_that_cannot_be_is_one_line(
    text: str | None, words: tuple[str, ...], said: str, place: Path, commands: Commands
):
    (place / "fleet.yaml").write_text(text or "")
    given = ("--fleet", "fleet.yaml") if text is not None else ()
    done = commands("watch", *words, *given, *OPTIONS)
    assert done.status == 2 and said in done.err and len(done.err.strip().splitlines()) == 1
