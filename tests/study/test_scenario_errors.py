"""What is wrong with a sweep, a sample, an override or an event is said with file, line, value and remedy."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.support.scenario_text import GOOD, study_of, write
from workbench.core.errors import InputError
from workbench.core.yaml_strict import dumps, loads
from workbench.study.load import LONGEST_CHAIN, load_study

ROOT = Path(__file__).resolve().parents[2]
KP, KI = "controller.kp_nm_s_per_rad", "controller.ki_nm_per_rad"
COULOMB = "machine.guide.coulomb_hoisting_n"
RELATIVE = "{distribution: normal, mean: 1, std: 0.5, relative: true}"


def range_of(steps: int) -> str:
    return f"{{from: 1, to: 2, steps: {steps}}}"


# A place, and what is added to a good scenario that is refused there.
VARIED = [
    ("sweep.limits.jerk", "sweep: {limits.jerk: [1]}"),
    ("sweep.machine.wire.segment_lenght_m", "sweep: {machine.wire.segment_lenght_m: [30]}"),
    ("sweep.limits.jerk_m_s3[1]", "sweep:\n  limits.jerk_m_s3:\n    - 1\n    - 0"),
    ("sweep.moves[0].by_m[1]", "sweep:\n  moves[0].by_m: [1, 50]"),
    ("sweep.controller.anti_windup[1]", "sweep: {controller.anti_windup: [none, conditonal]}"),
    ("sweep.events.brake_release_s[0]", "sweep: {events.brake_release_s: [1]}"),
    ("sweep.payloads_kg", "sweep: {payloads_kg: [1]}"),
    ("payloads_kg", "sweep: {payload_kg: [1]}"),
    (f"sweep.{KP}", f"sweep: {{{KP}: []}}"),
    (f"sweep.{KP}", f"sweep: {{{KP}: [3, 3]}}"),
    (f"sweep.{KP}[0]", f"sweep: {{{KP}: [.inf]}}"),
    ("sweep.zip", f"sweep:\n  zip:\n    {KP}: [1, 2]\n    {KI}: [1, 2, 3]"),
    (f"sweep.zip.{KP}", f"sweep: {{{KP}: [1], zip: {{{KP}: [2]}}}}"),
    ("sweep", f"sweep: {{{KP}: {range_of(1000)}, {KI}: {range_of(1000)}}}"),
    (f"sweep.{KP}.stps", f"sweep: {{{KP}: {{from: 1, to: 2, stps: 3}}}}"),
    (f"sweep.{KP}", f"sweep: {{{KP}: {{from: 1, to: 2, step: 0.3}}}}"),
    (f"sweep.{KP}", f"sweep: {{{KP}: {{from: 0, to: 1, steps: 3, scale: log}}}}"),
    ("sample.count", "sample: {count: 0, tolerances: true}"),
    ("sample", "sample: {count: 100, method: sobol, tolerances: true}"),
    (f"sample.values.{COULOMB}.distribution", f"sample: {{count: 8, values: {{{COULOMB}: {{distribution: norml}}}}}}"),
    (
        "sample.values.guide.coulomb_hoisting_n",
        "sample: {count: 8, values: {guide.coulomb_hoisting_n: {distribution: uniform, low: 1, high: 2}}}",
    ),
    (f"sample.values.{COULOMB}", f"sample: {{count: 999, values: {{{COULOMB}: {RELATIVE}}}}}"),
    ("sample.values.payload_kg", "sample: {count: 8, values: {payload_kg: {distribution: uniform, low: 1, high: 2}}}"),
    (
        f"sample.values.{KP}",
        f"sweep: {{{KP}: [2]}}\nsample: {{count: 8, values: {{{KP}: {{distribution: uniform, low: 1, high: 2}}}}}}",
    ),
    (
        "sample.values.machine.rail.highest_position_m",
        f"sample: {{count: 8, values: {{machine.rail.highest_position_m: {RELATIVE}}}}}",
    ),
    ("machine_overrides.wire.segment_lenght_m", "machine_overrides: {wire.segment_lenght_m: 30}"),
    ("machine_overrides.wire.segment_length_m", "machine_overrides:\n  wire:\n    segment_length_m: long"),
    ("events", "events: {brake_release_s: 1}"),
    ("events", "events: {emergency_stop_s: 1}"),
    ("effects.no_such_effect", "effects: {no_such_effect: {a: 1.0}}"),
]
ELSEWHERE = {"sweep.zip": 10, "payloads_kg": 3}  # else in the last line that was added


@pytest.mark.parametrize(("place", "more"), VARIED)
def test_what_a_scenario_varies_is_checked_before_anything_runs(tmp_path: Path, place: str, more: str) -> None:
    with pytest.raises(InputError) as caught:
        study_of(tmp_path, more + "\n")
    assert (caught.value.place, caught.value.line) == (place, ELSEWHERE.get(place, 9 + more.count("\n")))
    assert str(caught.value).startswith(f"{tmp_path}") and "\n" not in str(caught.value)


# A place, what stands in a good scenario, and what is refused in its stead.
CHANGED = [
    ("references[0]", "[trapezoid, ruckig]", "[recorded]"),
    ("references[0].campaign", "[trapezoid, ruckig]", "[{kind: recorded, campaign: none, run: a}]"),
    ("references[0]", "[trapezoid, ruckig]", "[{kind: s_curve, campaign: none, run: a}]"),
    ("limits.lowering.jerk_m_s3", "jerk_m_s3: 0.8", "jerk_m_s3: 0.8, lowering: {jerk_m_s3: 0}"),
    ("limits.lowering.speed_m_s", "jerk_m_s3: 0.8", "jerk_m_s3: 0.8, lowering: {speed_m_s: 0.9}"),
    ("limits.jerk_m_s3", ", jerk_m_s3: 0.8", ""),
    ("limits", "limits: {speed_m_s: 0.7, acceleration_m_s2: 0.6, jerk_m_s3: 0.8}\n", ""),
    ("moves", "moves: [{by_m: 4.0}, {dwell_s: 0.5}, {to_m: 4.0}]\n", ""),
    ("start_position_m", "start_position_m: 4.0\n", ""),
    ("moves[0]", "{by_m: 4.0}", "{speed_m_s: 0.3}"),
    ("moves[1]", "{by_m: 4.0}", "{speed_m_s: 0.3, for_s: 5}"),
    ("references[1]", "[trapezoid, ruckig]", "[trapezoid, rukig]"),
    ("references", "[trapezoid, ruckig]", "[ruckig, ruckig]"),
    ("payloads_kg", "payloads_kg: [0, 9000]\n", ""),
    ("payloads_kg[1]", "[0, 9000]", "[0, -9000]"),
    ("moves[0]", "{by_m: 4.0}", "{by_m: 4.0, to_m: 3.0}"),
    ("limits.speed_m_s", "speed_m_s: 0.7", "speed_m_s: 0.9"),
    ("controller.kp_nm_s_per_rad", "kp_nm_s_per_rad: 31.0", "kp_nm_s_per_rad: -31.0"),
    ("name", "name: small", "name: ../small"),
    ("moves", "by_m: 4.0}", "by_m: 4.0}" + 3 * ", {dwell_s: 3000}"),
    ("moves[2]", "{to_m: 4.0}", "{to_m: 8.0}"),
]


@pytest.mark.parametrize(("place", "old", "new"), CHANGED)
def test_a_scenario_that_cannot_be_run_says_where(tmp_path: Path, place: str, old: str, new: str) -> None:
    with pytest.raises(InputError) as caught:
        study_of(tmp_path, "", old, new)
    line = None if old.endswith("\n") else GOOD[: GOOD.index(old)].count("\n") + 1
    assert (caught.value.place, caught.value.line) == (place, line)


def test_what_is_swept_need_not_stand_there_besides(tmp_path: Path) -> None:
    study = study_of(
        tmp_path, "sweep: {start_position_m: [4, 5], limits.jerk_m_s3: [1]}\n", "start_position_m: 4.0\n", ""
    )
    assert {spec.start_position_m for spec in study.specs} == {4.0, 5.0}


def test_a_scenario_that_is_not_there_or_is_a_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.yaml: no such file"):
        load_study(tmp_path / "none.yaml")
    with pytest.raises(InputError, match="is a folder; expected a file"):
        load_study(tmp_path)


def test_a_machine_of_the_scenario_is_sought_beside_it_and_its_errors_name_its_own_file(tmp_path: Path) -> None:
    shipped = (ROOT / "workbench" / "machines" / "default_hoist.yaml").read_text(encoding="utf-8")
    path = write(tmp_path, GOOD.replace("name: small", "name: small\nmachine: mine.yaml"))
    mine = tmp_path / "mine.yaml"
    mine.write_text(shipped.replace("mass_kg: 8000.0", "mass_kg: 7000.0"), encoding="utf-8")
    assert load_study(path).machine.carriage.mass_kg == 7000.0
    mine.write_text(shipped.replace("mass_kg: 8000.0", "mass_kg: -8000.0"), encoding="utf-8")
    with pytest.raises(InputError, match=r"mine\.yaml:\d+: carriage.mass_kg: -8000.0"):
        load_study(path)
    mine.write_text("kind: axis\nmotion: linear\nmass_kg: 95.0\n", encoding="utf-8")
    with pytest.raises(InputError):
        load_study(path)


def test_fingerprint_follows_what_the_scenario_says_and_not_how_it_is_written(tmp_path: Path) -> None:
    one = load_study(write(tmp_path, GOOD)).fingerprint
    assert load_study(write(tmp_path, "# a remark\n" + GOOD.replace("0.7,", "0.70,"))).fingerprint == one
    assert load_study(write(tmp_path, GOOD.replace("9000", "9001"))).fingerprint != one


# Scenarios that go on from another: merged key by key, each error in the file where its key stands.


def child(folder: Path, text: str, base: str = GOOD) -> Path:
    write(folder, base, "base.yaml")
    return write(folder, f"extends: base.yaml\nname: child\n{text}", "child.yaml")


def test_blocks_are_merged_and_lists_replaced(tmp_path: Path) -> None:
    study = load_study(child(tmp_path, "limits: {jerk_m_s3: 2}\npayloads_kg: [100]\ncontroller: {ki_nm_per_rad: 60}\n"))
    limits = study.scenario.limits
    assert (limits.speed_m_s, limits.jerk_m_s3) == (0.7, 2.0)
    assert study.scenario.payloads_kg == (100.0,)
    assert (study.scenario.controller.kp_nm_s_per_rad, study.scenario.controller.ki_nm_per_rad) == (31.0, 60.0)
    assert study.scenario.name == "child"


def test_null_takes_a_block_back(tmp_path: Path) -> None:
    base = GOOD + "sweep: {limits.jerk_m_s3: [1, 2]}\n"
    assert len(load_study(child(tmp_path, "", base)).specs) == 8
    assert len(load_study(child(tmp_path, "sweep: null\n", base)).specs) == 4


@pytest.mark.parametrize(
    ("text", "base", "says"),
    [
        ("limits: {jerk_m_s3: 0}\n", GOOD, r"child\.yaml:3: limits.jerk_m_s3: 0, expected"),
        ("", GOOD.replace("jerk_m_s3: 0.8", "jerk_m_s3: 0"), r"base\.yaml:6: limits.jerk_m_s3: 0, expected"),
        ("limits: {speed_m_s: 0.5}\n", GOOD.replace("0.8}", "0.8, jrk: 1}"), r"base\.yaml:6: limits.jrk: unknown key"),
        ("moves:\n  - by_m: 99\n", GOOD, r"child\.yaml:4: moves\[0\]: .* leaves the rail"),
        ("start_position_m: 24\n", GOOD, r"base\.yaml:5: moves\[0\]: goes from 24 m to 28 m"),
        ("sweep: {limits.jrk: [1]}\n", GOOD, r"child\.yaml:3: sweep.limits.jrk: unknown field"),
        ("lead_s: 1\n", GOOD + "sweep:\n  limits.jerk_m_s3: [0]\n", r"base\.yaml:10: sweep.limits.jerk_m_s3\[0\]: 0.0"),
        ("", GOOD + "machine: none.yaml\n", r"base\.yaml:9: machine: no machine file"),
    ],
)
def test_an_error_names_the_file_in_which_its_key_stands(tmp_path: Path, text: str, base: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        load_study(child(tmp_path, text, base))


def test_a_circle_is_named(tmp_path: Path) -> None:
    write(tmp_path, "extends: b.yaml\n", "a.yaml")
    write(tmp_path, "\nextends: a.yaml\n", "b.yaml")
    with pytest.raises(InputError, match=r"b\.yaml:2: extends: goes in a circle: a.yaml extends b.yaml extends a.yaml"):
        load_study(tmp_path / "a.yaml")


def test_a_chain_has_an_end(tmp_path: Path) -> None:
    write(tmp_path, GOOD, "s0.yaml")
    for k in range(1, LONGEST_CHAIN + 1):
        write(tmp_path, f"extends: s{k - 1}.yaml\n", f"s{k}.yaml")
    load_study(tmp_path / f"s{LONGEST_CHAIN - 1}.yaml")
    with pytest.raises(InputError, match="chain of more than 10 files"):
        load_study(tmp_path / f"s{LONGEST_CHAIN}.yaml")


@pytest.mark.parametrize(
    ("extends", "says"),
    [
        ("none.yaml", "no scenario file"),
        ("3", "3, expected the path"),
        ("[a]", "expected the path"),
        (".", "no scenario file"),
        ('"a\\0b"', "is not a path"),
    ],
)
def test_what_cannot_be_extended_is_named(tmp_path: Path, extends: str, says: str) -> None:
    with pytest.raises(InputError, match=rf"child\.yaml:1: extends: .*{says}"):
        load_study(write(tmp_path, f"extends: {extends}\n", "child.yaml"))


# However a scenario is mangled: it is read, or refused in one line; nothing else comes out.


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
