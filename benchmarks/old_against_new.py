"""Whether this tree gives the numbers that another state of it gave: the commands over scenarios, campaigns and axes.

    python -m benchmarks.old_against_new store DIR [--only WORD]     run the commands of this tree, keep what they write
    python -m benchmarks.old_against_new compare DIR [--only WORD]   run them again, compare number by number

WORD: only the commands in whose name it stands, such as `study`, `replay`. `compare` prints, for each file, the largest
relative difference of a number and the first place where anything else differs. What a run says of itself
(date, version, time taken) is left out. Exit status 1 where a number differs by more than 1e-6 of its size.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parents[0] / "shared" / "data"
CAMPAIGNS = ("01", "05", "09", "14", "21", "24", "26", "33", "40", "46")
AXES = ("01", "03", "09", "15", "17", "22")
DIAGNOSED = ("campaigns/05", "campaigns/21", "campaigns/33", "axes/03", "axes/17", "real/geared_pendulum")
CLOSE = 1e-6
NUMBER = re.compile(r"-?\d+\.?\d*(?:[eE][+-]?\d+)?")
OWN = re.compile(r"date|version|cpu|took|seconds|created|guid|generationDateAndTime", re.IGNORECASE)


def commands() -> Iterator[tuple[str, list[str]]]:
    """A name for people, and the words of the command; OUT stands for its new folder."""
    for scenario in sorted((ROOT / "scenarios").glob("*.yaml")):
        yield f"study {scenario.stem}", ["study", str(scenario), "--out", "OUT"]
        yield f"loop {scenario.stem}", ["loop", "--scenario", str(scenario), "--out", "OUT"]
    yield "tune hoist", ["tune", "--scenario", str(ROOT / "scenarios/payloads.yaml"), "--out", "OUT/tuned.yaml"]
    yield "tune axis", ["tune", "--scenario", str(ROOT / "scenarios/axis.yaml"), "--out", "OUT/tuned.yaml"]
    for folder in [*(f"campaigns/{n}" for n in CAMPAIGNS), *(f"axes/{n}" for n in AXES), "real/geared_pendulum"]:
        for command in ("replay", "identify"):
            yield f"{command} {folder}", [command, str(DATA / folder), "--out", "OUT"]
    for folder in DIAGNOSED:
        yield f"diagnose {folder}", ["diagnose", str(DATA / folder), "--out", "OUT"]
    yield "diagnose demo", ["diagnose", str(ROOT / "scenarios/demo_campaign"), "--out", "OUT"]
    yield "compare-models 01", ["compare-models", str(DATA / "campaigns/01"), "--runs", "half_fast", "--out", "OUT"]
    yield "export-fmu", ["export-fmu", "default", "--platforms", "none", "--out", "OUT/hoist.fmu"]
    for form in ("st", "c", "yaml"):
        controller = str(ROOT / "scenarios/payloads.yaml")
        yield f"export-controller {form}", ["export-controller", controller, "--as", form, "--out", "OUT"]


def run(words: list[str], out: Path) -> None:
    words = [word.replace("OUT", str(out)) for word in words]
    if words[-1] != str(out):
        out.mkdir(parents=True)
    done = subprocess.run([sys.executable, "-m", "workbench", *words], cwd=ROOT, capture_output=True, text=True)
    out.mkdir(parents=True, exist_ok=True)
    (out / "terminal.txt").write_text(done.stdout.replace(str(out), "OUT"), encoding="utf-8")
    (out / "status.txt").write_text(f"{done.returncode}\n{done.stderr if done.returncode else ''}", encoding="utf-8")


def leaves(path: Path) -> list[tuple[str, object]]:
    """(place, value) of all that a file holds."""
    if path.suffix == ".json":
        return list(_walk("", json.loads(path.read_text(encoding="utf-8"))))
    if path.suffix == ".parquet":
        return list(_walk("", pq.read_table(path).to_pylist()))
    if path.suffix == ".fmu":
        with zipfile.ZipFile(path) as archive:
            names = [n for n in archive.namelist() if n.endswith((".c", ".h", ".xml"))]
            return [(n, archive.read(n).decode()) for n in names]
    return [(f"line {k}", line) for k, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)]


def _walk(place: str, value: object) -> Iterator[tuple[str, object]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            if not OWN.search(str(key)):
                yield from _walk(f"{place}.{key}", inner)
    elif isinstance(value, list):
        for k, inner in enumerate(value):
            yield from _walk(f"{place}[{k}]", inner)
    else:
        yield place, value


def apart(old: object, new: object) -> float:
    """The largest relative difference of the numbers in two values; inf where anything else differs."""
    texts = str(old), str(new)
    if texts[0] == texts[1] or OWN.search(texts[0]):
        return 0.0
    shape = [NUMBER.sub("#", text) for text in texts]
    if shape[0] != shape[1]:
        return math.inf
    pairs = [(float(a), float(b)) for a, b in zip(*(NUMBER.findall(text) for text in texts), strict=True)]
    return max((abs(a - b) / max(abs(a), abs(b), 1e-9) for a, b in pairs), default=0.0)


def compared(old: Path, new: Path) -> tuple[float, str]:
    """The largest difference of two files, and where the first large one is."""
    before, after = leaves(old), dict(leaves(new))
    worst, where = 0.0, ""
    for place, value in before:
        difference = apart(value, after[place]) if place in after else math.inf
        if difference > CLOSE and not where:
            where = f"{place}: {str(value)[:80]} | {str(after.get(place, 'missing'))[:80]}"
        worst = max(worst, difference)
    return worst, where


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("task", choices=["store", "compare"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default="")
    said = parser.parse_args()
    differs = False
    for name, words in commands():
        if said.only not in name:
            continue
        kept = said.folder.resolve() / name.replace(" ", "_").replace("/", "_")
        if said.task == "store":
            shutil.rmtree(kept, ignore_errors=True)
            run(words, kept)
            print(f"stored   {name}", flush=True)
            continue
        with tempfile.TemporaryDirectory() as folder:
            new = Path(folder) / "out"
            run(words, new)
            for old in sorted(kept.rglob("*")):
                if old.suffix not in {".json", ".yaml", ".txt", ".parquet", ".fmu", ".c", ".h", ".st", ".xml"}:
                    continue
                fresh = new / old.relative_to(kept)
                worst, where = compared(old, fresh) if fresh.exists() else (math.inf, "missing")
                differs |= worst > CLOSE
                if worst > CLOSE:
                    print(f"DIFFERS  {name} {old.relative_to(kept)}: {worst:.1e} at {where}", flush=True)
            print(f"compared {name}", flush=True)
    return int(differs)


if __name__ == "__main__":
    raise SystemExit(main())
