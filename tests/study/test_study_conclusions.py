"""What a study is said to come to, and comparisons of two: from rows made by hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner, Result
from hypothesis import given
from hypothesis import strategies as st

from workbench.cli.compare import compare as command
from workbench.core.errors import InputError
from workbench.metrics import fixed_columns
from workbench.study.compare import compare, matched, parse_limits, regressions
from workbench.study.conclude import rank_correlations, sentences
from workbench.study.front import fronts, knee, non_dominated
from workbench.study.labels import drawn_columns
from workbench.study.load import changed, load_study, plan_study
from workbench.study.rows import Row, index_table
from workbench.study.run import run_study
from workbench.study.scenario import MoveBlock
from workbench.view.study import conclusions

ROOT = Path(__file__).resolve().parents[2]

LIMIT = 768.0
JERK = "sweep.limits.jerk_m_s3"


def row(assigned: dict[str, float | str], payload: float = 9000.0, kind: str = "ruckig", **changes: float) -> Row:
    metrics = dict.fromkeys(fixed_columns(), 0.0) | {
        "moves": 2.0, "hold_torque_nm": 800.0, "slack_events": 0.0, "peak_torque_motor_nm": 500.0,
        "peak_torque_above_static_nm": 300.0, "speed_error_max_rad_s": 10.0, "min_wire_tension_n": 6e4,
        "wire_tension_swing_n": 1e4, "move_time_s": 36.0,
    }  # fmt: skip
    name = "_".join([f"{payload:g}kg", kind, *(f"{value}" for value in assigned.values())])
    return Row(name, "s", "ok", "", payload, kind, metrics | changes, assigned)


def front_rows() -> list[Row]:
    """Move time against peak: a hyperbola, and one run that another beats in both."""
    rows = [
        row({JERK: 10.0 / t}, move_time_s=30.0 + t, peak_torque_motor_nm=400.0 + 200.0 / t)
        for t in (1.0, 2.0, 4.0, 8.0)
    ]
    return [*rows, row({JERK: 9.0}, move_time_s=39.0, peak_torque_motor_nm=650.0)]


def test_the_knee_is_said_with_its_price_per_move_and_what_it_takes_off():
    # To 0…1: x = (t − 1)/7, y = (200/t − 25)/175; farthest below the chord is t = 2 or 4 by symmetry of 1/t about √8.
    (knee,) = [text for text in sentences(front_rows(), LIMIT) if "knee" in text]
    assert "with jerk 5 m/s³: 32 s and 500 N m" in knee or "with jerk 2.5 m/s³: 34 s and 450 N m" in knee
    assert "between 31 s for 600 and 38 s for 425 at the ends" in knee and "edge" not in knee


def test_a_sweep_is_judged_on_the_references_that_read_it():
    """A trapezoid knows no jerk: its peak, the worst of all, hides nothing of what the jerk does to ruckig."""
    rows = [row({JERK: j}, peak_torque_motor_nm=400.0 + 50.0 * j) for j in (1.0, 2.0)]
    rows += [row({JERK: j}, kind="trapezoid", peak_torque_motor_nm=600.0) for j in (1.0, 2.0)]
    (text,) = [sentence for sentence in sentences(rows, LIMIT) if sentence.startswith("Jerk ")]
    assert "the torque peak per motor goes from 450 to 500 N m" in text


def sample_rows(n: int = 200) -> list[Row]:
    rng = np.random.default_rng(3)
    mass, stiffness = rng.normal(8000.0, 30.0, n), rng.normal(1e11, 5e9, n)
    return [
        row(
            {"sample.machine.carriage.mass_kg": float(m), "sample.machine.wire.youngs_modulus_pa": float(k)},
            peak_torque_motor_nm=500.0 + 0.1 * (m - 8000.0),
        )
        for m, k in zip(mass, stiffness, strict=True)
    ]


def test_the_scatter_is_said_with_its_quantiles_and_what_it_hangs_on():
    rows = sample_rows()
    peaks = [of_run["peak_torque_motor_nm"] for of_run in rows]
    (text,) = [sentence for sentence in sentences(rows, LIMIT) if "median" in sentence]
    assert f"{np.median(peaks):.0f} N m in the median" in text
    assert f"{np.quantile(peaks, 0.05):.0f} to {np.quantile(peaks, 0.95):.0f} N m in nine of ten" in text
    assert text.endswith("it depends most on carriage mass (rank correlation +1.00).")


def test_rank_correlation_is_that_of_scipy_with_ties():
    from scipy.stats import spearmanr

    rng = np.random.default_rng(5)
    values = rng.integers(0, 6, 60).astype(float)
    rows = [row({"sample.x_s": v}, speed_error_max_rad_s=float(v + rng.integers(0, 5))) for v in values]
    (correlation,) = rank_correlations(rows, drawn_columns(rows), "speed_error_max_rad_s")
    wanted = spearmanr(values, [of_run["speed_error_max_rad_s"] for of_run in rows]).statistic
    assert correlation.value == pytest.approx(wanted, rel=1e-12)


def test_a_cycle_that_is_said_to_be_repeatable_heats_no_winding_beyond_nominal_torque_however_often():
    """Refuted from outside: the moves themselves four times over, and a winding's first-order heat over a thousand."""
    base = load_study(ROOT / "scenarios" / "payloads.yaml")
    once = changed(base.scenario, {"payloads_kg": (9000.0,), "references": ("trapezoid",), "lead_s": 0.0})
    dwell = MoveBlock(dwell_s=once.settle_s)
    moves = (*once.moves, dwell)
    four = changed(once, {"moves": moves * 4, "settle_s": 0.0})
    results = [run_study(plan_study(scenario, base.machine)) for scenario in (once, four)]
    said = conclusions(results[0])
    assert any("the cycle can be repeated without end" in text for text in said)
    (own,), (again,) = (result.rows for result in results)
    assert again["thermal_load_percent"] == pytest.approx(own["thermal_load_percent"], rel=0.02)
    assert abs(again["position_error_end_m"]) < abs(own["position_error_end_m"]) + 1e-3
    run = results[0].runs[own.run_id]
    nominal = base.machine.motor.nominal_torque_nm
    heat_in = (np.maximum(np.abs(run["torque_motor1_nm"]), np.abs(run["torque_motor2_nm"])) / nominal) ** 2
    dt, tau_s, hottest, heat = run.sample_time_s, 600.0, 0.0, 0.0
    per_cycle = np.exp(-len(heat_in) * dt / tau_s)
    rise = float(np.sum(heat_in * np.exp(-(len(heat_in) - 1 - np.arange(len(heat_in))) * dt / tau_s)) * dt / tau_s)
    for _ in range(1000):
        heat = heat * per_cycle + rise
        hottest = max(hottest, heat)
    assert hottest <= 1.0  # of what nominal torque heats to


# Time against torque. (4, 6) and (6, 5) are beaten; the second (3, 3) is the first one again.
HAND = [(1.0, 10.0), (2.0, 4.0), (4.0, 6.0), (3.0, 3.0), (3.0, 3.0), (6.0, 5.0), (8.0, 2.5), (10.0, 1.0)]


def row_pareto(
    name: str, time_s: float, torque: float, payload: float = 0.0, kind: str = "ruckig", status: str = "ok"
) -> Row:
    metrics = dict.fromkeys(fixed_columns(), 0.0) | {"move_time_s": time_s, "peak_torque_motor_nm": torque}
    metrics |= {"max_wire_tension_n": 10.0 * torque, "min_wire_tension_n": 2.0 * torque}
    return Row(name, "s", status, "", payload, kind, metrics)


def test_knee_lies_farthest_below_the_chord_of_the_normalised_front() -> None:
    # Normalised: (0, 1), (1/9, 1/3), (2/9, 2/9), (7/9, 1/6), (1, 0); 1 − x − y: 0, 5/9, 5/9, 1/18, 0.
    first, second = np.array([1.0, 2.0, 3.1, 8.0, 10.0]), np.array([10.0, 4.0, 3.0, 2.5, 1.0])
    assert knee(first, second) == 1
    assert knee(np.array([1.0, 2.0, 2.9, 8.0, 10.0]), second) == 2


@pytest.mark.parametrize(
    ("first", "second"),
    [([], []), ([1.0], [1.0]), ([1.0, 2.0], [2.0, 1.0]), ([1.0, 2.0, 3.0], [3.0, 2.0, 1.0]),
     ([1.0, 2.0, 3.0], [3.0, 2.9, 1.0])],
)  # fmt: skip
def test_a_short_straight_or_bulging_front_has_no_knee(first: list[float], second: list[float]) -> None:
    assert knee(np.array(first), np.array(second)) is None


costs = st.lists(st.tuples(st.integers(0, 12), st.integers(0, 12)), max_size=40)


@given(costs)
def test_front_is_what_brute_force_finds(points: list[tuple[int, int]]) -> None:
    first, second = np.array([p[0] for p in points], float), np.array([p[1] for p in points], float)
    front = [points[i] for i in non_dominated(first, second)]

    def beaten(p: tuple[int, int]) -> bool:
        return any(q[0] <= p[0] and q[1] <= p[1] and q != p for q in points)

    assert front == sorted({p for p in points if not beaten(p)})


def test_each_payload_has_its_front_and_failed_runs_are_not_on_it() -> None:
    rows = [row_pareto(f"a{k}", t, y) for k, (t, y) in enumerate(HAND)]
    rows += [row_pareto("b", 5.0, 5.0, payload=9000.0), row_pareto("failed", 0.1, 0.1, status="failed")]
    empty, full = fronts(rows)
    assert [r.run_id for r in empty.rows] == ["a0", "a1", "a3", "a6", "a7"]
    assert empty.knee is not None and empty.knee.run_id in ("a1", "a3")
    assert (full.payload_kg, full.knee, [r.run_id for r in full.rows]) == (9000.0, None, ["b"])


# Comparisons: deltas by hand, runs matched by id or by what they are, limits that end with status 1.


MEASURED = dict.fromkeys(fixed_columns(), 1.0)


def row_of(run_id: str, payload: float = 9000.0, **metrics: float) -> Row:
    return Row(run_id, "s", "ok", "", payload, "ruckig", MEASURED | metrics, {"sweep.kp": payload})


def failed(one: Row, reason: str = "ran away") -> Row:
    return replace(one, status="failed", reason=reason, metrics=dict.fromkeys(one.metrics))


PEAK = "peak_torque_motor_nm"
A = [row_of("a", 0.0, peak_torque_motor_nm=100.0), row_of("b", peak_torque_motor_nm=200.0), row_of("c", 1.0)]
B = [row_of("a", 0.0, peak_torque_motor_nm=104.0), row_of("b", peak_torque_motor_nm=190.0), row_of("c", 1.0)]


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
    twins = [row_of("x"), row_of("y")]
    pairs, only_a, only_b = matched(twins, [row_of("v"), row_of("w")])
    assert (pairs, only_a, only_b) == ([], ["x", "y"], ["v", "w"])


def test_runs_without_a_partner_and_runs_that_newly_fail_are_named() -> None:
    comparison = compare([*A, row_of("gone", 5.0)], [B[0], failed(B[1]), B[2], row_of("new", 6.0)])
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
    comparison = compare([row_of("a", **{metric: a})], [row_of("a", **{metric: b})])
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
    pq.write_table(index_table([row_of("z", 77.0)]), folders[1] / "index.parquet")
    with pytest.raises(
        InputError, match=r"no run is in both A \(.*a\) and B \(.*b\): payload is .* in A and 77 kg in B"
    ):
        called(folders, *words)
