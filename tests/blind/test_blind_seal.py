"""The seal: nothing leaks, every change after it is found out and named, and a stop in the middle loses nothing."""

from __future__ import annotations

import json
import os
import shutil
import stat
import sys
import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest

from workbench.blind import make as making
from workbench.blind import run, seal
from workbench.blind.make import Asked, Made, Maker, make
from workbench.blind.run import Answer, text_of
from workbench.blind.score import OPENED, open_all, open_and_score, sheet_of
from workbench.blind.seal import Entry, Label, Order, copy_of, entries
from workbench.cli import main
from workbench.core.errors import InputError
from workbench.view.blind import sentences

SEED = 424242424242
TRUTH = ("friction_viscous", "heave", "torque_offset", "")


def fake(folder: Path, order: Order) -> tuple[Order, Label]:
    """A campaign of a few bytes; of four, three withhold an effect and one none."""
    campaign = folder / order.name
    (campaign / "runs").mkdir(parents=True)
    for name in ("machine.yaml", "runs.yaml", "runs/first.csv"):
        (campaign / name).write_text(f"{name} of {order.name}\n")
    name = TRUTH[(order.number - 1) % len(TRUTH)]
    effects = (name,) if name else ()
    label = Label(
        effects, (), {}, tuple({"subsystem": "guide", "regime": "speed"} for _ in effects), (), "", {}, "singles",
        "hoist", order.family, "a hoist", order.seed, {"B_up": 1.0}, order.source,
        torque_change_rms_nm=5.0 if effects else 0.0,
    )  # fmt: skip
    return order, label


def said(campaign: Path) -> str:
    """An answer that needs no campaign: friction_viscous throughout."""
    assert sorted(path.name for path in campaign.iterdir()) == ["machine.yaml", "runs", "runs.yaml"]
    names = ("friction_viscous",)
    row = Answer(campaign.name, "named", names=names, ranking=[("named", list(names), 0.9)], noise=0.5, kind="hoist")
    return text_of(replace(row, before=5.0, after=0.6, cpu_s=1.0, subsystem="guide"))


def makes(count: int, seed: int) -> Maker:
    """Campaigns whose contents nobody reads."""
    return Maker([Order(k, (seed, k), "simulator", "hoist_small", "singles", ()) for k in range(1, count + 1)], fake)


@pytest.fixture
def made(tmp_path: Path) -> Made:
    return make(Asked(cases=4, seed=SEED), tmp_path / "test", processes=1, maker=makes(4, SEED))


def answered(made: Made, **more: Any) -> run.Ran:
    return run.run(made.folder, processes=1, diagnose=said, **more)


def every_file(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_neither_label_nor_seed_nor_key_stands_in_the_folder(made: Made):
    files = every_file(made.folder)
    key = made.key.read_bytes().strip()
    for name, data in files.items():
        for secret in (b"heave", b"friction_viscous", b"torque_offset", str(SEED).encode(), key):
            assert secret not in data, name
    assert made.key == made.folder.with_name("test.key")
    assert stat.S_IMODE(made.key.stat().st_mode) == 0o600 or os.name != "posix"


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda f: (f / "campaigns/002/runs/first.csv").write_text("other"), "campaign 002: the file was changed"),
        (lambda f: (f / "campaigns/002/runs/first.csv").unlink(), "campaign 002: the file is gone"),
        (lambda f: (f / "campaigns/003/notes.txt").write_text("hint"), "campaign 003: the file was added"),
        (lambda f: (f / seal.SEALED).write_bytes(b"x" + (f / seal.SEALED).read_bytes()), "sealed labels were changed"),
        (lambda f: (f / seal.SEALED).unlink(), "labels.sealed: no such file"),
        (lambda f: altered(f / "answers/001.json", "friction_viscous", "heave"), "campaign 001 was changed since"),
        (lambda f: shutil.copy(f / "answers/001.json", f / "answers/009.json"), "which the manifest does not have"),
        (lambda f: (f / "answers/002.json").unlink(), "answer to campaign 002, given .*, is gone"),
        (lambda f: (f / "answers.jsonl").unlink(), "was not given by `workbench blind run`"),
        (lambda f: altered(f / "manifest.json", '"version": "', '"version": "9'), "changed since campaign 001"),
        (lambda f: altered(f / "manifest.json", '"seal_sha256": "', '"seal_sha256": "0'), "manifest.json"),
        (lambda f: (f / "manifest.json").write_text("{"), "is damaged"),
        (lambda f: (f / "answers.jsonl").write_text("{}\n"), "is damaged"),
        (lambda f: cut_off(f / "answers.jsonl"), r"answers\.jsonl:4: is damaged or cut off"),
        (lambda f: cut_off(f / "answers/004.json"), "campaign 004 was changed"),
    ],
)
def test_a_change_after_sealing_is_found_out_and_named(made: Made, change: Any, sentence: str):
    answered(made)
    change(made.folder)
    with pytest.raises(InputError, match=sentence):
        open_and_score(made.folder, made.key)
    assert not (made.folder / OPENED).exists()


def lines_of(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "answers.jsonl").read_text().splitlines()]


def written(folder: Path, lines: list[dict[str, Any]]) -> None:
    (folder / "answers.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))


def swapped(folder: Path) -> None:
    """Two answers and the hashes of their lines."""
    one, two = (folder / "answers" / f"{name}.json" for name in ("001", "002"))
    texts = one.read_text(), two.read_text()
    one.write_text(texts[1])
    two.write_text(texts[0])
    lines = lines_of(folder)
    lines[0]["sha256"], lines[1]["sha256"] = lines[1]["sha256"], lines[0]["sha256"]
    written(folder, lines)


def replaced(folder: Path) -> None:
    file = folder / "answers" / "002.json"
    altered(file, "friction_viscous", "heave")
    lines = lines_of(folder)
    lines[1]["sha256"] = seal.sha256(file.read_bytes())
    written(folder, lines)


def removed(folder: Path, name: str = "002") -> None:
    """An answer with its line."""
    (folder / "answers" / f"{name}.json").unlink()
    written(folder, [line for line in lines_of(folder) if line["case"] != name])


def dated(folder: Path) -> None:
    lines = lines_of(folder)
    lines[1]["at"] = "2020-01-01T00:00:00+00:00"
    written(folder, lines)


FORGED = {
    "swapped": (swapped, "001"),
    "replaced": (replaced, "002"),
    "removed": (removed, "00[23]"),
    "dated": (dated, "002"),
}


def chained_anew(folder: Path) -> None:
    """What somebody does who knows how the chain is made."""
    before, lines = seal.sha256((folder / "manifest.json").read_bytes()), []
    for line in lines_of(folder):
        entry = Entry(**line).chained(before)
        before = entry.chain
        lines.append(asdict(entry))
    written(folder, lines)


@pytest.mark.parametrize(("forge", "named"), FORGED.values(), ids=FORGED)
def test_a_forged_answer_is_named_by_the_chain(made: Made, forge: Any, named: str):
    answered(made)
    forge(made.folder)
    copy_of(made.folder).unlink()
    with pytest.raises(InputError, match=rf"the answer to campaign {named}: its line, or one before it, was changed"):
        open_and_score(made.folder, made.key)


@pytest.mark.parametrize(("forge", "named"), FORGED.values(), ids=FORGED)
def test_a_chain_that_was_computed_anew_is_named_by_the_copy_and_by_the_head(made: Made, forge: Any, named: str):
    head = answered(made).head
    forge(made.folder)
    chained_anew(made.folder)
    with pytest.raises(InputError, match=rf"answer to campaign {named}, "):
        open_and_score(made.folder, made.key)
    with pytest.raises(InputError, match=rf"and not in {head}: an answer was changed, removed or dated anew"):
        open_and_score(made.folder, made.key, head)
    with pytest.raises(InputError, match=rf"answer to campaign {named}, "):  # nor does a run go on with it
        answered(made)


def test_a_last_answer_that_was_removed_is_named(made: Made):
    head = answered(made).head
    removed(made.folder, "004")
    with pytest.raises(InputError, match=r"answer to campaign 004, given .*, was removed"):
        open_and_score(made.folder, made.key)
    with pytest.raises(InputError, match="and not in"):
        open_and_score(made.folder, made.key, head)


def test_the_sheet_says_how_the_answers_were_compared(made: Made):
    first = answered(made, count=2).head
    head = answered(made).head
    assert open_and_score(made.folder, made.key).compared.startswith("The ledger is that of test.answers; against")
    assert open_and_score(made.folder, made.key, head).compared == "The answers are those of the given head."
    assert open_and_score(made.folder, made.key, first).compared.endswith("answers to 003, 004 were given after it.")
    copy_of(made.folder).unlink()
    assert "unproved" in open_and_score(made.folder, made.key).compared
    assert head == entries(made.folder)[-1].chain
    with pytest.raises(InputError, match="is no head"):
        open_and_score(made.folder, made.key, "notes.txt")


def cut_off(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-40])


def altered(file: Path, before: str, after: str) -> None:
    text = file.read_text()
    assert before in text
    file.write_text(text.replace(before, after))


def test_a_manifest_that_was_made_to_fit_a_changed_campaign_does_not_fit_the_seal(made: Made):
    file = made.folder / "campaigns" / "002" / "machine.yaml"
    before = seal.sha256(file.read_bytes())
    file.write_text("another machine\n")
    altered(made.folder / "manifest.json", before, seal.sha256(file.read_bytes()))
    answered(made)
    with pytest.raises(InputError, match="other files or hashes of campaign 002 than the seal"):
        open_and_score(made.folder, made.key)


def test_labels_sealed_anew_by_another_key_are_no_labels(made: Made, tmp_path: Path):
    answered(made)
    manifest = seal.read_manifest(made.folder)
    truth = seal.unseal(made.folder, manifest, made.key)
    other = tmp_path / "other.key"
    forged = replace(truth, labels={name: {**label, "effects": []} for name, label in truth.labels.items()})
    seal.write_key(other, seal.seal(made.folder, forged, manifest.made, manifest.version, manifest.asked))
    with pytest.raises(InputError, match=r"manifest\.json: was changed since campaign 001"):
        open_and_score(made.folder, other)
    with pytest.raises(InputError, match="was changed since"):
        open_and_score(made.folder, made.key)


@pytest.mark.parametrize(
    ("key", "sentence"), [("", "no key there"), ("short", "is not the key"), ("A" * 43 + "=", "is not the key")]
)
def test_without_the_right_key_nothing_is_opened(made: Made, tmp_path: Path, key: str, sentence: str):
    answered(made)
    file = tmp_path / "given.key"
    if key:
        file.write_text(key)
    with pytest.raises(InputError, match=sentence):
        open_and_score(made.folder, file)
    assert not (made.folder / OPENED).exists()


def test_each_diagnosis_is_given_a_folder_of_its_own_away_from_the_seal(made: Made):
    seen: list[Path] = []

    def look(campaign: Path) -> str:
        seen.append(campaign)
        assert campaign.resolve().parents[0] != (made.folder / "campaigns").resolve()
        assert not list(campaign.resolve().parents[0].glob("*.sealed"))
        assert len(list(campaign.parent.iterdir())) == 1
        return said(campaign)

    run.run(made.folder, processes=1, diagnose=look)
    assert len({path.parent for path in seen}) == len(seen)
    assert not any(path.exists() for path in seen)


def test_a_run_goes_on_where_it_stopped_and_a_part_can_be_scored(made: Made):
    assert replace(answered(made, count=1), head="") == run.Ran(4, 0, 1)
    first = open_and_score(made.folder, made.key)
    assert first.partial and len(first.rows) == 1
    lines: list[str] = []
    time.sleep(1.1)  # the clock of the ledger has seconds
    assert replace(answered(made, tell=lines.append), head="") == run.Ran(4, 1, 4)
    assert lines[0] == "goes on after 1 of 4"
    assert lines[-1].startswith("4/4 campaign 004: friction_viscous (0.90), 1 s; 0 min left")
    second = open_and_score(made.folder, made.key)
    assert second.opened == first.opened
    assert second.after_opening == ("002", "003", "004")
    openings = json.loads((made.folder / OPENED).read_text())["openings"]
    assert [len(opening["answers"]) for opening in openings] == [1, 4]
    open_and_score(made.folder, made.key)
    assert len(json.loads((made.folder / OPENED).read_text())["openings"]) == 2


def test_an_answer_given_anew_after_the_opening_is_found_out(made: Made):
    answered(made)
    open_and_score(made.folder, made.key)
    (made.folder / "answers" / "002.json").unlink()
    run.run(made.folder, processes=1, diagnose=lambda campaign: said(campaign).replace("viscous", "coulomb"))
    with pytest.raises(InputError, match="campaign 002 is answered otherwise than when the seal was opened"):
        open_and_score(made.folder, made.key)


def another(made: Made, tmp_path: Path) -> Made:
    other = make(Asked(seed=SEED + 1), tmp_path / "more", processes=1, maker=makes(2, SEED + 1))
    answered(made)
    answered(other)
    return other


def test_several_folders_are_scored_as_one_and_each_campaign_says_its_folder(made: Made, tmp_path: Path):
    other = another(made, tmp_path)
    sheet = sheet_of(open_all([made.folder, other.folder]))
    assert sheet.cases == len(sheet.rows) == 6
    assert [row["folder"] for row in sheet.rows] == [f"test/00{k}" for k in (1, 2, 3, 4)] + ["more/001", "more/002"]
    assert [row["folder"] for row in sheet_of(open_all([made.folder])).rows] == ["001", "002", "003", "004"]
    said_of = " ".join(sentences(sheet))
    for score in (made, other):
        assert f"{score.folder.name}: Seal (SHA-256) {score.seal_sha256}" in said_of
    assert f"Seed {SEED}." in said_of


def test_campaigns_do_not_count_twice_and_one_key_opens_one_folder(made: Made, tmp_path: Path):
    other = another(made, tmp_path)
    copied = tmp_path / "copy"
    shutil.copytree(made.folder, copied)
    shutil.copy(made.key, tmp_path / "copy.key")
    with pytest.raises(InputError, match="has the same seal as"):
        sheet_of(open_all([made.folder, copied]))
    with pytest.raises(InputError, match="key: is of one folder"):
        open_all([made.folder, other.folder], made.key)


# The command


def exit_of(*words: object) -> object:
    with pytest.raises(SystemExit) as ended:
        main([str(word) for word in words])
    return ended.value.code


def test_the_command_makes_runs_and_scores(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys):
    monkeypatch.setattr(making, "maker_of", lambda asked, seed, tell: makes(asked.cases, seed))
    monkeypatch.setattr(run, "answered", lambda folder, most_effects: said(folder))
    folder = tmp_path / "proof"
    make = ("blind", "make", "--out", folder, "--cases", 4, "--seed", 3, "--family", "hoist_small", "--processes", 1)
    assert exit_of(*make) == 0
    assert "Seal (SHA-256)" in capsys.readouterr().out
    assert exit_of("blind", "run", folder, "--processes", 1) == 0
    assert "4 of 4 campaigns have an answer, 4 of them new." in capsys.readouterr().out
    assert exit_of("blind", "score", folder, "--out", tmp_path / "sheet") == 0
    out = capsys.readouterr().out
    assert "single effect named" in out and "1/3 (6–79)" in out and "no gap, but named" in out
    said_there = json.loads((tmp_path / "sheet" / "score.json").read_text())
    assert said_there["groups"]["hoist, simulator"]["named"] == pytest.approx(
        {"count": 1, "of": 3, "low_95": 0.0614919, "high_95": 0.792345}, rel=1e-5
    )
    assert [case["right"] for case in said_there["cases"]] == [True, False, False, False]
    assert "| single effect named | ≥ 95 | 1/3 (6–79) |" in (tmp_path / "sheet" / "score.md").read_text()
    page = (tmp_path / "sheet" / "score.html").read_text()
    assert "Wilson" in page and "http" not in page.split("<body>")[1].split("plotly")[0]
    assert exit_of(*make) == 2
    assert "nothing is overwritten" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["make", "--out", "x", "--source", "simulater"], "--source: unknown source 'simulater'; did you mean"),
        (["make", "--out", "x", "--family", "hoist_smal"], "did you mean 'hoist_small'?"),
        (["make", "--out", "x", "--source", "multibody", "--kind", "axis"], "does not play machines of kind axis"),
        (["make", "--out", "x", "--machine", "machine.yaml"], "--machine: needs runs"),
        (["run", "nowhere"], "no such folder"),
    ],
)
def test_what_does_not_fit_is_one_line_and_writes_nothing(words, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert exit_of("blind", *words) == 2
    err = capsys.readouterr().err
    assert sentence in err and "Traceback" not in err
    assert list(tmp_path.iterdir()) == []


def test_a_key_that_is_there_is_not_overwritten(tmp_path: Path):
    (tmp_path / "test.key").write_text("mine")
    with pytest.raises(InputError, match="nothing is overwritten"):
        make(Asked(cases=1, seed=1), tmp_path / "test", processes=1, maker=makes(1, 1))
    assert (tmp_path / "test.key").read_text() == "mine"
    assert not (tmp_path / "test").exists()


def test_where_only_the_package_is_installed_the_simulators_are_named_as_missing(tmp_path, monkeypatch, capsys):
    for name in [name for name in sys.modules if name.startswith("benchmarks.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "benchmarks", None)  # as where there is none
    assert exit_of("blind", "make", "--out", tmp_path / "x", "--cases", 1) == 2
    said_there = capsys.readouterr().err
    assert "--source: simulator, multibody, plant are in benchmarks/validation of a checkout" in said_there
    assert list(tmp_path.iterdir()) == []
