"""The attack on the readers: repeatable, counts what breaks, and finds nothing in a small sample."""

from __future__ import annotations

import difflib
from typing import Any

import pytest

from benchmarks.attack.__main__ import attack
from benchmarks.attack.mangle import KINDS, MADE_BY_THE_VICTIM, good, mangled
from benchmarks.attack.victim import read


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_makes_the_same_bytes_and_another_one_others(kind):
    inputs = [mangled(kind, seed) for seed in range(30)]
    assert inputs == [mangled(kind, seed) for seed in range(30)]
    assert len(set(inputs)) > 25


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in MADE_BY_THE_VICTIM])
def test_what_is_mangled_reads_when_whole(tmp_path, kind):
    # The first scenarios extend another one, as they stand in their folder.
    ended = read(kind, good(kind, 0), tmp_path)
    assert (ended.how, ended.said) == ("read", "")


@pytest.mark.parametrize("seed", [11000141, 12000034])
def test_mat_files_that_crash_scipy_are_refused(tmp_path, seed):
    ended = read("mat", mangled("mat", seed), tmp_path)
    assert ended.how == "refused"
    assert "lift.mat: lift: " in ended.said


@pytest.mark.parametrize("seed", [11000099, 12000131])
def test_of_thousands_of_junk_keys_only_those_that_are_told_are_compared_with_names(tmp_path, seed, monkeypatch):
    compared: list[str] = []
    compare = difflib.get_close_matches

    def counted(word: str, *rest: Any, **how: Any) -> list[str]:
        compared.append(word)
        return compare(word, *rest, **how)

    monkeypatch.setattr(difflib, "get_close_matches", counted)
    ended = read("scenario", mangled("scenario", seed), tmp_path)
    assert ended.how == "refused"
    assert ended.said.endswith("(and 4995 more problems)")
    assert len(compared) == 5


def test_a_small_attack_breaks_nothing():
    results = attack(KINDS, range(100, 104))
    assert len(results) == 4 * len(KINDS)
    assert [(r.kind, r.seed, r.ended) for r in results if r.bad] == []
    assert {result.ended.how for result in results} <= {"read", "noted", "refused"}
