"""`python -m benchmarks.practice CAMPAIGNS --out ANSWERS`: recorded campaigns with open labels, judged alike.

CAMPAIGNS holds a folder for each campaign and labels/NAME.json. What is answered stays; the sheet is of all answers.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from workbench.blind.make import mapped
from workbench.blind.run import answer, load, save, text_of
from workbench.view import blind as tables


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("campaigns", type=Path)
    parser.add_argument("--out", type=Path, required=True, help="folder for the answers; what is there is kept")
    parser.add_argument("--names", nargs="*", help="of the campaigns; all without it")
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    for line in answered(given.campaigns, given.out, given.names, given.processes):
        print(line, flush=True)
    rows = rows_of(given.campaigns, given.out)
    for table in (tables.sheet_table(rows), tables.amounts(rows), tables.confusion_table(rows), tables.misses(rows)):
        print(f"\n{table.markdown()}")


def answered(campaigns: Path, out: Path, names: list[str] | None, processes: int) -> Iterator[str]:
    """Diagnoses what has no answer yet, a line each as it is done."""
    there = names or sorted(label.stem for label in (campaigns / "labels").glob("*.json"))
    left = [name for name in there if not (out / f"{name}.json").exists()]
    with mapped(processes) as over:
        yield from over(partial(_one, campaigns, out), left)


def _one(campaigns: Path, out: Path, name: str) -> str:
    effects = _label(campaigns, name)["effects"]
    given = answer(campaigns / name)
    save(text_of(given), out / f"{name}.json")
    return f"{name}: {'+'.join(effects) or 'none'} -> {given.word} {'+'.join(given.names)}; {given.cpu_s:.0f} s"


def _label(campaigns: Path, name: str) -> dict[str, Any]:
    said: dict[str, Any] = json.loads((campaigns / "labels" / f"{name}.json").read_text(encoding="utf-8"))
    return said


def rows_of(campaigns: Path, out: Path) -> list[dict[str, Any]]:
    """The answers in `out`, joined with their labels; `source` is the folder's name."""
    return [{**row, "source": campaigns.name, "label": _label(campaigns, name)} for name, row in load(out).items()]


if __name__ == "__main__":
    main()
