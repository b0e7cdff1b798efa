"""Machine records: what they accept, how they refuse, that files round-trip, that values have names."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel

from workbench.core.errors import InputError
from workbench.core.yaml_strict import dumps, load, loads
from workbench.effects import of
from workbench.machines import (
    RECORDS,
    Hoist,
    LinearAxis,
    RotaryAxis,
    default_hoist,
    get_value,
    load_machine,
    machine_from,
    machine_text,
    save_machine,
    value_names,
    with_values,
)
from workbench.study.scenario import Scenario


def machine_of(text: str) -> Hoist | LinearAxis | RotaryAxis:
    machine = machine_from(loads(text, "machine.yaml"))
    assert isinstance(machine, Hoist | LinearAxis | RotaryAxis)
    return machine


def refusal(text: str) -> str:
    with pytest.raises(InputError) as caught:
        machine_of(text)
    return str(caught.value)


def test_default_hoist_is_the_nominal_machine_of_the_first_campaign(campaigns):
    recorded = load_machine(campaigns / "01" / "machine.yaml")
    wire = default_hoist().wire.model_copy(update={"breaking_load_n": None})  # which campaigns do not ask about
    assert default_hoist().model_copy(update={"wire": wire}) == recorded


def test_every_recorded_machine_loads_and_says_exactly_its_file(campaigns):
    files = sorted(campaigns.glob("*/machine.yaml"))
    assert len(files) >= 33
    for file in files:
        again = loads(machine_text(load_machine(file)), file).data
        recorded = loads(file.read_text(), file).data
        assert isinstance(again, dict)
        assert isinstance(recorded, dict)
        # Tolerances that the file leaves at their defaults are written too.
        stated = again["tolerances"]
        assert isinstance(stated, dict)
        again["tolerances"] = {key: stated[key] for key in recorded["tolerances"]}
        assert {key: again[key] for key in recorded} == recorded
        assert [key for key in again if key in recorded] == list(recorded), "key order is kept"


def test_missing_kind_means_hoist_and_missing_format_means_one():
    text = machine_text(default_hoist()).replace("format: 1\nkind: hoist\n", "")
    assert machine_of(text) == default_hoist()


MISTAKES = {
    ("ratio: 31.0", "ratio: -31"): "machine.yaml:10: gearbox.ratio: -31, expected a number greater than 0",
    ("ratio: 31.0", "ratio: '31'"): "gearbox.ratio: '31', expected a number without quotes",
    ("ratio: 31.0", "ratio: 31,0"): "gearbox.ratio: '31,0', expected a number with a decimal point",
    ("ratio: 31.0", "ratio: 31 rad"): "units belong to the key's name",
    ("ratio: 31.0", "ration: 31.0"): "gearbox.ration: unknown key 'ration'; did you mean 'ratio'?",
    ("gearbox:\n  ratio: 31.0\n", ""): "gearbox: is missing; expected a block with ratio",
    ("coefficient: 0.02", "coefficient: 20"): "expected a number less than 1",
    ("count: 2", "count: 1.5"): "motor.count: 1.5, expected a whole number",
    ("pin_diameter_m: 0.1\n", "pin_diameter_m: 0.6\n"): "sheave: pin_diameter_m 0.6, expected less than diameter_m 0.5",
    ("lowest_position_m: 0.0", "lowest_position_m: 26"): "rail from 26.0 to 25.0 m",
    ("format: 1", "format: 2"): "machine.yaml:1: format: 2, this version reads format 1",
    ("kind: hoist", "kind: hoits"): "machine.yaml:2: kind: unknown kind 'hoits'; did you mean 'hoist'?",
    ("kind: hoist", "kind: axis"): "motion: is missing; valid: linear, rotary",
    ("overload: 1.6", "overload: 1.6\n  torque_lagg: 3"): (
        "drive.torque_lagg: unknown key 'torque_lagg'; did you mean 'torque_lag_s'?"
    ),
}


@pytest.mark.parametrize(("old", "new"), MISTAKES)
def test_mistake_in_a_machine_is_named_by_line_and_place(old, new):
    text = machine_text(default_hoist())
    assert old in text
    assert MISTAKES[old, new] in refusal(text.replace(old, new, 1))


def test_several_mistakes_are_listed_in_one_line_and_at_most_five():
    text = machine_text(default_hoist()).replace("_m:", "_mm:")
    said = refusal(text)
    assert "\n" not in said
    assert said.count("machine.yaml:") == 5
    assert said.endswith("more problems)")


def test_a_number_for_a_key_is_what_stands_behind_a_decimal_comma():
    said = refusal(machine_text(default_hoist()).replace("gearbox:\n  ratio: 31.0", "gearbox: {ratio: 31,5}"))
    assert "unknown key '5'; is it what stands behind a decimal comma?" in said


def test_the_valid_keys_of_a_block_are_listed_once():
    said = refusal("name: lift\npayloads_kg: [0]\nzzz: 1\n")
    assert said.count("unknown key") == 2 and said.count("valid: ") == 1


def test_with_values_checks_like_a_file():
    with pytest.raises(InputError, match=r"carriage.mass_kg: -3.0, expected a number greater than 0"):
        with_values(default_hoist(), {"carriage.mass_kg": -3.0})
    with pytest.raises(InputError, match=r"did you mean 'guide.coulomb_hoisting_n'\?"):
        with_values(default_hoist(), {"guide.coulomb_hoistin_n": 1.0})
    with pytest.raises(InputError, match=r"rail.highest_position_m: has no value"):
        get_value(default_hoist(), "rail.highest_position_m")
    with pytest.raises(InputError, match="whole number"):
        with_values(default_hoist(), {"motor.count": 1.5})


POSITIVE = st.floats(min_value=0.01, max_value=1e4, allow_nan=False)  # within the bounds of every value
JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**9), 10**9) | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text().filter(lambda key: key != "<<"), inner),
    max_leaves=8,
)  # fmt: skip


@given(
    mass=POSITIVE, ratio=POSITIVE, level=POSITIVE, load=st.none() | POSITIVE, name=st.text(),
    effects=st.dictionaries(
        st.text(min_size=1).filter(lambda key: key != "<<"),
        st.dictionaries(st.sampled_from(["a", "1e5", "yes", "no"]), st.floats(-1e15, 1e15)),
        max_size=3,
    ),
    identified=st.dictionaries(st.text().filter(lambda key: key != "<<"), JSON, max_size=3),
)  # fmt: skip
def test_saved_machine_loads_as_the_very_same(tmp_path_factory, mass, ratio, level, load, name, effects, identified):
    base = with_values(
        default_hoist(), {"carriage.mass_kg": mass, "gearbox.ratio": ratio, "guide.coulomb_lowering_n": level}
    )
    wire = base.wire.model_copy(update={"breaking_load_n": load})
    machine = Hoist.model_validate(
        base.model_dump() | {"wire": wire.model_dump(), "name": name, "effects": effects, "identified": identified}
    )
    file = tmp_path_factory.getbasetemp() / "round_trip.yaml"
    save_machine(machine, file)
    assert load_machine(file) == machine


TEXT = machine_text(default_hoist())


@given(data=st.data())
def test_mangled_machine_is_read_or_refused_by_name(tmp_path_factory, data):
    lines = TEXT.splitlines()
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(lines) - 1))
        what = data.draw(st.sampled_from(["drop", "double", "value", "key", "cut", "indent"]))
        if what == "drop":
            del lines[at]
        elif what == "double":
            lines.insert(at, lines[at])
        elif what == "value":
            word = data.draw(
                st.sampled_from(["-1", "1e400", ".nan", "[1]", "{a: b}", "'", "&x", "*x", "yes", "9" * 50])
            )
            lines[at] = lines[at].split(":")[0] + ": " + word
        elif what == "key":
            lines[at] = lines[at].replace("_", data.draw(st.sampled_from(["", "-", ": ", "\t"])), 1)
        elif what == "cut":
            lines[at] = lines[at][: data.draw(st.integers(0, len(lines[at])))]
        else:
            lines[at] = " " + lines[at]
        lines = lines or [""]
    file: Path = tmp_path_factory.getbasetemp() / "mangled_machine.yaml"
    file.write_text("\n".join(lines))
    try:
        machine = load_machine(file)
    except InputError as error:
        refusal, machine = str(error), None
    if machine is None:
        assert all("mangled_machine.yaml" in line for line in refusal.splitlines())
    else:
        assert all(math.isfinite(get_value(machine, name)) for name in value_names(machine))


# The strict YAML reader: what words mean, what it refuses, which line it names.


WORDS = {
    "1e5": 1e5, "1.5e-3": 1.5e-3, ".5": 0.5, "-7": -7, "010": 10, "0x1f": 31, "0o17": 15, "-.inf": -math.inf,
    "yes": "yes", "off": "off", "1:30": "1:30", "2024-01-01": "2024-01-01", "1_000": "1_000", "1,5": "1,5",
    "true": True, "False": False, "~": None, "null": None, "'1e5'": "1e5", '"true"': "true",
}  # fmt: skip


@pytest.mark.parametrize("word", WORDS)
def test_unquoted_words_mean_what_yaml_1_2_says(word):
    value = loads(f"key: {word}", "f.yaml").data["key"]  # type: ignore[index]
    assert value == WORDS[word]
    assert type(value) is type(WORDS[word])


REFUSED = {
    "a: 1\nb: 2\na: 3\n": (3, "key 'a' is doubled; it stands on line 1"),
    "a:\n\tb: 1\n": (2, "indent with spaces"),
    "a: [1, 2\nb: 3\n": (2, "is not YAML"),
    "a: !!python/object/apply:os.system [ls]\n": (1, "tag 'tag:yaml.org,2002:python/object/apply:os.system'"),
    "a: 1\n---\nb: 2\n": (2, "a second document"),
    "a: *nowhere\n": (1, "alias *nowhere"),
    "# only a comment\n": (None, "is empty"),
    "a: &x {b: 1}\nc: {<<: *x}\n": (2, "merge keys"),
    "? [1, 2]\n: 3\n": (1, "a key must be a plain word"),
    "a: &x [*x]\n": (1, "alias *x"),
    "a: '\x01'\n": (1, "is not YAML"),
    "": (None, "is empty"),
}


@pytest.mark.parametrize("text", REFUSED)
def test_refused_text_is_named_by_line(text):
    line, words = REFUSED[text]
    with pytest.raises(InputError) as caught:
        loads(text, "f.yaml")
    assert words in str(caught.value)
    assert caught.value.line == line
    assert str(caught.value).startswith("f.yaml")
    assert "\n" not in str(caught.value)


def test_alias_bomb_is_refused_before_it_fills_memory():
    levels = "\n".join(f"k{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 12))
    with pytest.raises(InputError, match="more than 200000 values"):
        loads(f"k0: &a0 [1]\n{levels}\n", "bomb.yaml")


def test_deep_nesting_is_refused_without_recursion_error():
    with pytest.raises(InputError, match="nested more than 40 deep"):
        loads("[" * 500 + "]" * 500, "deep.yaml")


def test_device_for_a_file_is_said():
    with pytest.raises(InputError, match="is not a regular file"):
        load("/dev/zero")


def test_byte_that_is_not_utf8_is_named_by_line(tmp_path):
    file = tmp_path / "machine.yaml"
    file.write_bytes(b"a: 1\nname: Kran f\xfcr Rohre\n")
    with pytest.raises(InputError, match=r"machine.yaml:2: byte 0xfc is not UTF-8"):
        load(file)


def test_log_given_for_yaml_is_refused_by_size(tmp_path):
    file = tmp_path / "log.csv"
    file.write_bytes(b"1,2,3\n" * 1_000_000)
    with pytest.raises(InputError, match="larger than 5 MB"):
        load(file)


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**16), 10**16) | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=20,
)


@given(st.dictionaries(st.text().filter(lambda key: key != "<<"), PLAIN, min_size=1, max_size=5))
def test_plain_data_survives_writing_and_reading(data):
    if "<<" in repr(data):
        return
    assert loads(dumps(data), "f.yaml").data == data


@given(st.text(max_size=300))
def test_any_text_is_read_or_refused_in_one_line(text):
    refusal = "some.yaml"
    try:
        loads(text, Path("some.yaml"))
    except InputError as error:
        refusal = str(error)
    assert refusal.startswith("some.yaml")
    assert len(refusal.splitlines()) == 1


# Every number of a file has bounds with a reason, and what lies beyond them is refused with a hint.


def boundless(record: type[BaseModel], prefix: str = "") -> Iterator[str]:
    """Numbers that may be anything."""
    for name, field in record.model_fields.items():
        parts = (field.annotation, *get_args(field.annotation))
        metadata = [*field.metadata, *(m for part in parts for m in getattr(part, "__metadata__", ()))]
        flat = [inner for mark in metadata for inner in getattr(mark, "metadata", [mark])]
        if float in parts and not all(
            any(getattr(m, end, None) is not None for m in flat for end in ends)
            for ends in (("ge", "gt"), ("le", "lt"))
        ):
            yield f"{prefix}{name}"
        for part in parts:
            if isinstance(part, type) and issubclass(part, BaseModel):
                yield from boundless(part, f"{prefix}{name}.")


@pytest.mark.parametrize("record", [*RECORDS, Scenario])
def test_no_number_may_be_anything(record):
    assert list(boundless(record)) == []


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("  speed_delay_s: 5", "drive.speed_delay_s: 5, expected a number from 0 to 0.2; is it in milliseconds?"),
        ("  rotor_inertia_kg_m2: 8e299", "8e+299, expected a number from 1e-09 to 1e+09; is it in kg m²?"),
        ("  ratio: 1e308", "gearbox.ratio: 1e+308, expected a number from 0.001 to 100000"),
        ("  coulomb_hoisting_n: -1", "guide.coulomb_hoisting_n: -1, expected a number of at least 0"),
    ],
)
def test_a_slip_of_units_is_refused_with_a_hint(line, said):
    key = line.split(":")[0]
    text = "\n".join(line if row.startswith(f"{key}:") else row for row in machine_text(default_hoist()).split("\n"))
    with pytest.raises(InputError) as refused:
        machine_from(loads(text, "machine.yaml"))
    assert said in str(refused.value)


# A machine as a diagnosis delivers it, with allowances and a log, goes through what takes machines.


DELIVERED = Hoist.model_validate(
    default_hoist().model_dump()
    | {
        "effects": {"heave": {"amplitude_m": 0.1, "frequency_rad_s": 0.9, "phase_rad": 1.0}},
        "allowances": {"friction_viscous": {"viscous_n_s_per_m": 28.0}},
        "log": {"speed_late_s": 0.004, "of_runs": {"full": {"heave": {"phase_rad": 2.0}}}},
    }
)


def test_it_is_saved_and_read_back(tmp_path: Path):
    save_machine(DELIVERED, tmp_path / "machine.yaml")
    assert load_machine(tmp_path / "machine.yaml") == DELIVERED


def test_allowances_and_the_logs_lateness_are_at_work_as_effects_are():
    values = of(DELIVERED).values_of(0.0)
    assert values["friction_viscous__viscous_n_s_per_m"] == 28.0
    assert values["speed_delay__delay_s"] == pytest.approx(0.004)
    assert not any(name.startswith("log.") for name in value_names(DELIVERED))


def test_a_run_has_its_own_values_and_every_other_run_the_machines():
    active = of(DELIVERED)
    assert active.values_of(0.0, "full")["heave__phase_rad"] == 2.0
    assert active.values_of(0.0, "empty")["heave__phase_rad"] == 1.0


def test_a_runs_own_value_of_an_effect_that_is_not_there_is_one_error():
    log = DELIVERED.log.model_copy(update={"of_runs": {"full": {"haeve": {"phase_rad": 2.0}}}})
    with pytest.raises(InputError, match=r"haeve is no effect of this machine.*heave"):
        of(DELIVERED.model_copy(update={"log": log}))
