"""A metric that is declared is shown everywhere: one is added here, and looked for in every place."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from tests.support.commands import Commands
from tests.support.dashboard_app import page
from tests.support.scenario_text import GOOD, write
from workbench.cli import cli
from workbench.machines import default_hoist
from workbench.metrics import LoopMetric, RunMetric, add, columns, find, forget_added
from workbench.study.store import read_finished

# Numbers of its own, from accumulators that the compiled loop keeps already.
DRUM = LoopMetric(
    name="peak_drum_torque_nm", unit="N m", label="drum torque peak", better="lower", visible=10.0,
    definition="largest torque of the drum, one motor's torque times the ratio", shown_in="kN m", scale=1e-3,
    accumulators=find("peak_torque_motor_nm").accumulators,  # type: ignore[attr-defined]
    finish=lambda a, p, duration: a[0] * p.ratio,
)  # fmt: skip
LONGEST = RunMetric(
    name="longest_move_s", unit="s", label="longest move", better="lower", visible=1e-3,
    definition="time of the longest move of the reference", known_before=True,
    value=lambda run: max(end - start for start, end in run.move_windows),
)  # fmt: skip
RATIO = default_hoist().gearbox.ratio


@pytest.fixture(scope="module")
def declared() -> Iterator[None]:
    add(DRUM, LONGEST)
    yield
    forget_added()


@pytest.fixture(scope="module")
def folders(declared: None, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Results of a plain study and of one with a weaker controller."""
    folder = tmp_path_factory.mktemp("declared")
    texts = {"plain": GOOD, "weaker": GOOD.replace("kp_nm_s_per_rad: 31.0", "kp_nm_s_per_rad: 15.0")}
    for name, text in texts.items():
        file = write(folder, text, f"{name}.yaml")
        done = CliRunner().invoke(cli, ["study", str(file), "--out", str(folder / name)], catch_exceptions=False)
        assert done.exit_code == 0, done.output
    return {name: folder / name for name in texts}


def test_it_is_a_column_of_the_index_with_its_own_numbers(folders: dict[str, Path]) -> None:
    for row in read_finished(folders["plain"]).rows:
        assert row["peak_drum_torque_nm"] == pytest.approx(RATIO * row["peak_torque_motor_nm"])
        assert row["longest_move_s"] == pytest.approx(row["move_time_s"] / 2.0)
    assert columns()[-1] == "longest_move_s" and "peak_drum_torque_nm" in columns()


def test_compare_shows_it_knows_which_way_is_worse_and_takes_limits(
    folders: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["compare", folders["plain"], folders["weaker"], "--json", tmp_path / "c.json"]
    done = Commands(capsys)(*words, "--max-regression", "peak_drum_torque=1")
    said = json.loads((tmp_path / "c.json").read_text())
    change = said["metrics"]["peak_drum_torque_nm"]
    assert change["max_delta"] == pytest.approx(RATIO * said["metrics"]["peak_torque_motor_nm"]["max_delta"])
    assert "peak_drum_torque_nm" in done.out
    assert said["regressions"] and all(run["b"] > run["a"] + 1.0 for run in said["regressions"])
    assert done.status == 1


def test_the_dashboard_shows_it_on_study_and_compare(declared: None) -> None:
    from streamlit.testing.v1 import AppTest

    app = page("Study").run()
    assert not app.exception
    # A heading holds the unit where the number would be cut beside it.
    assert {"Drum torque peak", "Longest move"} <= {number.label.split(" (")[0] for number in app.metric}
    source = (
        "import streamlit as st\nfrom workbench.dashboard.shell import run_page\n"
        "run_page(st.session_state.get('page', 'Study'))\n"
    )
    both = AppTest.from_string(source, default_timeout=60.0).run()
    both.button(key="study keep").click().run()
    both.session_state["page"] = "Compare"
    both.run()
    assert not both.exception
    words = {str(cell).replace("\\", "") for cell in both.table[0].value.iloc[:, 0]}
    assert {"Drum torque peak (kN m)", "Longest move (s)"} <= words
