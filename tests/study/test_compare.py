"""Comparisons: deltas by hand, runs matched by id or by what they are, limits that end with status 1."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner, Result

from workbench.cli.compare import compare as command
from workbench.core.errors import InputError
from workbench.metrics import fixed_columns
from workbench.study.compare import compare, matched, parse_limits, regressions
from workbench.study.rows import Row, index_table

MEASURED = dict.fromkeys(fixed_columns(), 1.0)


def row(run_id: str, payload: float = 9000.0, **metrics: float) -> Row:
    return Row(run_id, "s", "ok", "", payload, "ruckig", MEASURED | metrics, {"sweep.kp": payload})


def failed(one: Row, reason: str = "ran away") -> Row:
    return replace(one, status="failed", reason=reason, metrics=dict.fromkeys(one.metrics))


PEAK = "peak_torque_motor_nm"
A = [row("a", 0.0, peak_torque_motor_nm=100.0), row("b", peak_torque_motor_nm=200.0), row("c", 1.0)]
B = [row("a", 0.0, peak_torque_motor_nm=104.0), row("b", peak_torque_motor_nm=190.0), row("c", 1.0)]


def test_means_medians_and_largest_deltas_are_those_of_a_hand_calculation() -> None:
    (change,) = [change for change in compare(A, B).changes if change.metric == PEAK]
    assert change.mean_a == pytest.approx(301.0 / 3.0)
    assert change.mean_b == pytest.approx(295.0 / 3.0)
    assert change.mean_delta == pytest.approx(-2.0)
    assert change.median_delta == 0.0
    assert change.max_delta == -10.0
    assert change.mean_percent == pytest.approx(100.0 * -6.0 / 301.0)
    assert [pair.name for pair in change.worst] == ["b", "a"]  # c has not moved


def test_runs_of_other_ids_are_matched_by_payload_reference_and_assigned_values() -> None:
    renamed = [replace(of_run, run_id=f"new_{of_run.run_id}") for of_run in B]
    pairs, only_a, only_b = matched(A, renamed)
    assert [(pair.a.run_id, pair.b.run_id) for pair in pairs] == [("a", "new_a"), ("b", "new_b"), ("c", "new_c")]
    assert not only_a and not only_b
    assert compare(A, renamed).changes[0].mean_delta == compare(A, B).changes[0].mean_delta


def test_runs_that_values_cannot_tell_apart_are_not_matched_by_chance() -> None:
    twins = [row("x"), row("y")]
    pairs, only_a, only_b = matched(twins, [row("v"), row("w")])
    assert (pairs, only_a, only_b) == ([], ["x", "y"], ["v", "w"])


def test_runs_without_a_partner_and_runs_that_newly_fail_are_named() -> None:
    comparison = compare([*A, row("gone", 5.0)], [B[0], failed(B[1]), B[2], row("new", 6.0)])
    assert (comparison.only_a, comparison.only_b) == (("gone",), ("new",))
    assert [pair.name for pair in comparison.newly_failed] == ["b"]
    assert comparison.changes[0].runs == 2


@pytest.mark.parametrize(
    ("metric", "a", "b", "percent"),
    [
        ("peak_torque_percent", 100.0, 106.0, 6.0),  # lower is better
        ("peak_torque_percent", 100.0, 94.0, None),
        ("min_wire_tension_n", 1000.0, 940.0, 6.0),  # higher is better
        ("min_wire_tension_n", 1000.0, 1060.0, None),
        ("position_error_end_m", 0.1, -0.106, 6.0),  # nearer to zero is better
        ("position_error_end_m", -0.1, 0.05, None),
        ("slack_time_s", 0.0, 0.001, float("inf")),  # what was nothing has no per cent
        ("slack_time_s", 0.0, 0.0, None),
    ],
)
def test_worse_is_what_the_metric_says_is_worse(metric: str, a: float, b: float, percent: float | None) -> None:
    comparison = compare([row("a", **{metric: a})], [row("a", **{metric: b})])
    hits = regressions(comparison, parse_limits([f"{metric}=5%"], fixed_columns()))
    assert [hit.worse for hit in hits] == ([] if percent is None else [pytest.approx(percent)])
    still = regressions(comparison, parse_limits([f"{metric}=7%"], fixed_columns()))
    assert [hit.worse for hit in still] == ([percent] if percent == float("inf") else [])


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    for name, rows in (("a", A), ("b", B)):
        (tmp_path / name).mkdir()
        pq.write_table(index_table(rows), tmp_path / name / "index.parquet")
    return tmp_path / "a", tmp_path / "b"


def called(folders: Sequence[Path], *words: str) -> Result:
    done = CliRunner().invoke(command, [*map(str, folders), *words], standalone_mode=False)
    if done.exception is not None:
        raise done.exception
    return done


def test_the_command_answers_1_where_a_limit_is_exceeded_and_0_within(folders: tuple[Path, Path]) -> None:
    assert called(folders).return_value == 0
    good = called(folders, "--max-regression", "peak_torque_motor=5%")
    assert good.return_value == 0
    assert "Within peak_torque_motor_nm=5% in all 3 runs." in good.output
    bad = called(folders, "--max-regression", "peak_torque_motor=3%", "--max-regression", "rms_torque_motor=1%")
    assert bad.return_value == 1
    assert "a 100.0 → 104.0: worse by 4 %, allowed peak_torque_motor_nm=3%" in bad.output
    assert max(map(len, bad.output.splitlines())) <= 100


def test_a_run_that_newly_fails_breaks_any_limit(folders: tuple[Path, Path]) -> None:
    pq.write_table(index_table([B[0], failed(B[1]), B[2]]), folders[1] / "index.parquet")
    done = called(folders, "--max-regression", "peak_torque_motor=50%")
    assert done.return_value == 1
    assert "b failed: ran away" in done.output


@pytest.mark.parametrize("words", [(), ("--max-regression", "peak_torque=5%")])
def test_results_without_a_common_run_are_bad_input(folders: tuple[Path, Path], words: tuple[str, ...]) -> None:
    pq.write_table(index_table([row("z", 77.0)]), folders[1] / "index.parquet")
    with pytest.raises(
        InputError, match=r"no run is in both A \(.*a\) and B \(.*b\): payload is .* in A and 77 kg in B"
    ):
        called(folders, *words)
