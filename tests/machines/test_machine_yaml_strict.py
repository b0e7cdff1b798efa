"""The strict YAML reader: what words mean, what it refuses, which line it names."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from workbench.core.errors import InputError
from workbench.core.yaml_strict import dumps, load, loads

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


def test_every_place_knows_its_line():
    document = loads("runs:\n- name: a\n  payload_kg: 1\n- name: b\n  payload_kg: 2\n", "runs.yaml")
    assert document.line(("runs", 1, "payload_kg")) == 5
    assert document.line(("runs", 0, "name")) == 2
    assert document.line(("runs", 1, "file")) == 4, "a key that is missing stands where its block begins"


REFUSED = {
    "a: 1\nb: 2\na: 3\n": (3, "key 'a' is doubled; it stands on line 1"),
    "a:\n\tb: 1\n": (2, "indent with spaces"),
    "a: [1, 2\nb: 3\n": (2, "is not YAML"),
    "a: !!python/object/apply:os.system [ls]\n": (1, "tag 'tag:yaml.org,2002:python/object/apply:os.system'"),
    "a: 1\n---\nb: 2\n": (2, "a second document"),
    "a: *nowhere\n": (1, "alias *nowhere"),
    "a: &x {b: 1}\nc: {<<: *x}\n": (2, "merge keys"),
    "? [1, 2]\n: 3\n": (1, "a key must be a plain word"),
    "a: &x [*x]\n": (1, "alias *x"),
    "a: '\x01'\n": (1, "is not YAML"),
    "": (None, "is empty"),
    "# only a comment\n": (None, "is empty"),
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
