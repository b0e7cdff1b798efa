"""Whether this tree gives the very numbers that another one gives: replay, identify and a study, byte by byte.

    python -m benchmarks.old_against_new OLD_TREE [CAMPAIGN ...] [--study SCENARIO]

OLD_TREE: a checkout of the commit to compare with (`git worktree add --detach DIR COMMIT`). Of each campaign
replay.json, identify.json and the identified machine.yaml are compared, of the study its table of metrics;
what a run says of itself (date, time taken, version) is left out. Exit status 1 where anything differs.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parents[0] / "shared" / "data" / "campaigns"
CAMPAIGNS = tuple(DATA / name for name in ("01", "09", "40"))
STUDY = ROOT / "scenarios" / "payloads.yaml"
OWN = re.compile(r'^\s*"?(date|version)"?:.*$', re.MULTILINE)  # what a run says of itself
COMPARED = ("replay.json", "identify.json", "machine.yaml", "diagnosis.json")


def run(tree: Path, *words: str | Path) -> None:
    """One command of the workbench of a tree; its error ends the comparison."""
    command = [sys.executable, "-m", "workbench", *map(str, words)]
    done = subprocess.run(command, cwd=tree, env=os.environ | {"PYTHONPATH": str(tree)}, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{tree}: {' '.join(command)}\n{done.stdout}{done.stderr}")


def results(tree: Path, campaigns: list[Path], study: Path | None, out: Path, diagnose: bool) -> dict[str, str | bytes]:
    """name -> text of every figure that is compared."""
    texts: dict[str, str | bytes] = {}
    for number, campaign in enumerate(campaigns):
        for command in ("replay", "identify", *(("diagnose",) if diagnose else ())):
            folder = out / f"{command}-{number}"
            run(tree, command, campaign, "--out", folder)
            for file in (folder / name for name in COMPARED):
                if file.exists():
                    texts[f"{command} {campaign.name} {file.name}"] = OWN.sub("", file.read_text(encoding="utf-8"))
    if study is not None:
        from workbench.study.rows import read_rows

        run(tree, "study", study, "--out", out / "study")
        texts[f"study {study.name} index.parquet"] = "\n".join(map(repr, read_rows(out / "study")))
    return texts


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("old", type=Path)
    parser.add_argument("campaigns", type=Path, nargs="*")
    parser.add_argument("--study", type=Path, default=STUDY)
    parser.add_argument("--diagnose", action="store_true", help="compare diagnosis.json, too: a minute a campaign")
    said = parser.parse_args()
    campaigns = [path.resolve() for path in said.campaigns or CAMPAIGNS]
    with tempfile.TemporaryDirectory() as folder:
        old, new = (
            results(tree, campaigns, said.study.resolve(), Path(folder) / name, said.diagnose)
            for name, tree in (("old", said.old.resolve()), ("new", ROOT))
        )
    differ = sorted(name for name in old.keys() | new.keys() if old.get(name) != new.get(name))
    for name in sorted(old):
        print("DIFFERS" if name in differ else "same   ", name)
    return 1 if differ else 0


if __name__ == "__main__":
    raise SystemExit(main())
