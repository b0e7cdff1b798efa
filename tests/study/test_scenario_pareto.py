"""Pareto fronts and knees, against a set made by hand and against brute force."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from workbench.core.errors import InputError
from workbench.metrics import fixed_columns
from workbench.study.front import fronts, knee, non_dominated
from workbench.study.rows import Row

# Time against torque. (4, 6) and (6, 5) are beaten; the second (3, 3) is the first one again.
HAND = [(1.0, 10.0), (2.0, 4.0), (4.0, 6.0), (3.0, 3.0), (3.0, 3.0), (6.0, 5.0), (8.0, 2.5), (10.0, 1.0)]


def row(name: str, time_s: float, torque: float, payload: float = 0.0, kind: str = "ruckig", status: str = "ok") -> Row:
    metrics = dict.fromkeys(fixed_columns(), 0.0) | {"move_time_s": time_s, "peak_torque_motor_nm": torque}
    metrics |= {"max_wire_tension_n": 10.0 * torque, "min_wire_tension_n": 2.0 * torque}
    return Row(name, "s", status, "", payload, kind, metrics)


def test_front_of_a_set_made_by_hand() -> None:
    first, second = (np.array(x) for x in zip(*HAND, strict=True))
    assert non_dominated(first, second).tolist() == [0, 1, 3, 6, 7]


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
    rows = [row(f"a{k}", t, y) for k, (t, y) in enumerate(HAND)]
    rows += [row("b", 5.0, 5.0, payload=9000.0), row("failed", 0.1, 0.1, status="failed")]
    empty, full = fronts(rows)
    assert [r.run_id for r in empty.rows] == ["a0", "a1", "a3", "a6", "a7"]
    assert empty.knee is not None and empty.knee.run_id in ("a1", "a3")
    assert (full.payload_kg, full.knee, [r.run_id for r in full.rows]) == (9000.0, None, ["b"])


def test_a_misspelt_metric_is_told_its_nearest_name() -> None:
    with pytest.raises(InputError, match="no metric 'peak_torque'; "):
        fronts([row("a", 1.0, 5.0)], second="peak_torque")
