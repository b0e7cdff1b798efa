"""`python -m benchmarks.diagnosis.run CAMPAIGNS --out ANSWERS`: diagnose every campaign of a folder; resumes."""

from __future__ import annotations

import argparse
import multiprocessing
import os
import traceback
from pathlib import Path

from benchmarks.diagnosis.answers import answer, save


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("campaigns", type=Path, help="folder of campaigns with labels/NAME.json")
    parser.add_argument("--out", type=Path, required=True, help="folder for the answers; what is there is kept")
    parser.add_argument("--withhold", action="store_true", help="take the labelled effect out of the library")
    parser.add_argument("--singles-only", action="store_true", help="leave out labels with no or several effects")
    parser.add_argument("--count", type=int, help="of campaigns, the first ones")
    parser.add_argument("--max-effects", type=int, default=2)
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read by the processes as they start
    jobs = []
    for label in sorted((given.campaigns / "labels").glob("*.json"))[: given.count]:
        target = given.out / f"{label.stem}.json"
        if not target.exists():
            jobs.append((given.campaigns / label.stem, label, target, given))
    with multiprocessing.get_context("spawn").Pool(given.processes) as pool:
        for k, line in enumerate(pool.imap_unordered(_one, jobs)):
            print(f"{k + 1}/{len(jobs)} {line}", flush=True)


def _one(job: tuple[Path, Path, Path, argparse.Namespace]) -> str:
    import json

    folder, label, target, given = job
    effects = json.loads(label.read_text(encoding="utf-8"))["effects"]
    if given.singles_only and (len(effects) != 1 or "unlisted" in effects[0]):
        return f"{folder.name}: left out"
    try:
        kept = answer(folder, label, effects if given.withhold else (), given.max_effects)
    except Exception:
        return f"{folder.name}: FAILED\n{traceback.format_exc()}"
    save(kept, target)
    return (
        f"{folder.name}: {'+'.join(effects) or 'none'} -> {kept.word} {'+'.join(kept.names)} "
        f"{kept.ranking[0][2]:.2f}; {kept.before:.2f} -> {kept.after:.2f}, noise {kept.noise:.2f}; {kept.cpu_s:.0f} s"
    )


if __name__ == "__main__":
    main()
