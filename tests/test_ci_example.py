"""How a team asserts closed-loop metrics in its own tests, and what it reads when one is missed.

The first two tests are the example. Where workbench is installed, pytest knows `study_rows` without its import.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from workbench.core.errors import InputError
from workbench.metrics import fixed_columns
from workbench.study.rows import Row
from workbench.testing import StudyRows, assert_metric
from workbench.testing import study_rows as study_rows

pytest_plugins = ["pytester"]


def test_the_drive_has_room_left_at_full_load(study_rows: StudyRows) -> None:
    rows = study_rows("scenarios/payloads.yaml")
    assert_metric(rows, "peak_torque_percent", below=150, where={"payload_kg": 9000})
    assert_metric(rows, "peak_torque_percent", below=120, where={"payload_kg": 9000, "reference": "ruckig"})


def test_the_wire_never_goes_slack(study_rows: StudyRows) -> None:
    rows = study_rows("scenarios/payloads.yaml")
    assert_metric(rows, "min_wire_tension", above=20e3)
    assert_metric(rows, "slack_time", below=1e-9)


def test_a_scenario_is_run_once_in_a_session(study_rows: StudyRows, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = study_rows("scenarios/payloads.yaml")
    monkeypatch.setattr("workbench.testing.run_scenario", None)
    assert study_rows("scenarios/../scenarios/payloads.yaml") is rows


MEASURED = dict.fromkeys(fixed_columns(), 1.0)
ROWS = [
    Row("light", "s", "ok", "", 0.0, "ruckig", MEASURED | {"peak_torque_percent": 71.0}),
    Row("heavy", "s", "ok", "", 9000.0, "ruckig", MEASURED | {"peak_torque_percent": 137.25}),
    Row("lost", "s", "failed", "the carriage left the rail", 6e4, "ruckig", dict.fromkeys(fixed_columns())),
]


def test_a_missed_limit_says_which_run_and_by_which_value() -> None:
    with pytest.raises(AssertionError) as told:
        assert_metric(ROWS, "peak_torque", below=120, above=10)
    assert str(told.value).splitlines() == [
        "peak_torque_percent is not below 120 and above 10 in 2 of 3 runs:",
        "  heavy: 137.25",
        "  lost: failed: the carriage left the rail",
    ]


def test_a_choice_of_nothing_passes_no_test() -> None:
    with pytest.raises(AssertionError, match=r"no run has payload_kg 4500; there are: 0\.0, 60000\.0, 9000\.0"):
        assert_metric(ROWS, "peak_torque_percent", below=80, where={"payload_kg": 4500})
    with pytest.raises(AssertionError, match="there are no runs"):
        assert_metric([], "peak_torque_percent", below=80)


def test_a_misspelt_metric_or_column_gets_the_nearest() -> None:
    with pytest.raises(InputError, match=r"unknown metric 'peak_torqe'; did you mean 'peak_torque'\?"):
        assert_metric(ROWS, "peak_torqe", below=80)
    with pytest.raises(InputError, match=r"where: unknown column 'payload'; did you mean 'payload_kg'\?"):
        assert_metric(ROWS, "peak_torque", below=80, where={"payload": 0})
    with pytest.raises(TypeError, match="below, above or both"):
        assert_metric(ROWS, "peak_torque")


def test_pytest_finds_the_fixture_in_a_project_of_its_own(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = Path(__file__).resolve().parents[1]
    monkeypatch.setenv("PYTHONPATH", str(root))
    (pytester.path / "mine.yaml").write_bytes((root / "scenarios" / "payloads.yaml").read_bytes())
    pytester.makepyfile(
        """
        from workbench.testing import assert_metric

        def test_mine(study_rows):
            assert_metric(study_rows("mine.yaml"), "peak_torque_percent", below=100)
        """
    )
    # What the entry point does in an environment that workbench is installed in.
    done = pytester.runpytest_subprocess("-p", "workbench.testing")
    done.assert_outcomes(failed=1)
    done.stdout.fnmatch_lines(
        ["*peak_torque_percent is not below 100 in 3 of 9 runs:", "*9000kg_ruckig_equal_time: 107*"]
    )
