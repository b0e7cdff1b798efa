"""However a scenario is mangled: it is read, or refused in one line; nothing else comes out."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.support.scenario_text import GOOD, write
from workbench.core.errors import InputError
from workbench.core.yaml_strict import dumps, loads
from workbench.study.load import load_study

FULL = (
    GOOD
    + """\
machine_overrides: {wire: {segment_length_m: 30}, drive.overload: 2.0}
drive: {torque_lag_s: 0.002}
events: {motor_fails_s: 4.0}
outputs: {signals: none}
sweep: {limits.jerk_m_s3: {from: 0.4, to: 3.2, steps: 3, scale: log}, zip: {lead_s: [1, 2], settle_s: [1, 2]}}
sample:
  count: 4
  values: {machine.guide.coulomb_hoisting_n: {distribution: normal, mean: 1, std: 0.1, relative: true}}
"""
)

scalars = st.one_of(
    st.none(), st.booleans(), st.integers(-(10**20), 10**20), st.floats(), st.text(max_size=8),
    st.sampled_from(["default", "limits.jerk_m_s3", "machine.motor.count", "payload_kg", "moves[0].by_m", "recorded"]),
)  # fmt: skip
keys = st.one_of(
    st.text(max_size=8), st.sampled_from(["zip", "from", "limits.speed_m_s", "wire", "hoisting", "kind", "."])
)
wild = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(keys, inner, max_size=3), max_leaves=6
)


def places(data: Any, here: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    inner = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    return [here, *(place for key, value in inner for place in places(value, (*here, key)))]


def replaced(data: Any, place: tuple[Any, ...], value: Any) -> Any:
    if not place:
        return value
    if isinstance(data, dict):
        return {**data, place[0]: replaced(data[place[0]], place[1:], value)}
    return [*data[: place[0]], replaced(data[place[0]], place[1:], value), *data[place[0] + 1 :]]


def read_or_refused(path: Path) -> None:
    with contextlib.suppress(InputError):
        study = load_study(path)
        specs = study.specs
        assert len(specs) >= 1
        assert len({spec.run_id for spec in specs[:200]}) == min(len(specs), 200)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("mangled")


@settings(suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_any_value_in_any_place_is_read_or_refused(folder: Path, data: Any) -> None:
    plain = loads(FULL, "scenario.yaml").data
    place = data.draw(st.sampled_from(places(plain)[1:]))
    read_or_refused(write(folder, dumps(replaced(plain, place, data.draw(wild)))))


@settings(suppress_health_check=[HealthCheck.too_slow])
@given(
    st.sampled_from(
        ["sweep", "sample", "machine_overrides", "effects", "events", "extends", "references", "moves", "drive"]
    ),
    wild,
)
def test_any_content_of_a_block_is_read_or_refused(folder: Path, block: str, content: Any) -> None:
    plain = loads(FULL, "scenario.yaml").data
    assert isinstance(plain, dict)
    read_or_refused(write(folder, dumps({**plain, block: content})))


@settings(suppress_health_check=[HealthCheck.too_slow])
@given(st.integers(0, len(FULL)), st.integers(0, 30), st.text(max_size=6))
def test_any_cut_or_insertion_in_the_text_is_read_or_refused(folder: Path, at: int, cut: int, text: str) -> None:
    mangled = FULL[:at] + text + FULL[at + cut :]
    path = folder / "cut.yaml"
    path.write_bytes(mangled.encode("utf-8", "surrogatepass"))
    read_or_refused(path)
