"""`python -m benchmarks.diagnosis.run CAMPAIGNS --out ANSWERS`: diagnose every campaign of a folder; resumes."""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import traceback
from dataclasses import dataclass
from pathlib import Path

from benchmarks.diagnosis.answers import answer, save


@dataclass(frozen=True)
class Asked:
    """campaigns: folder of campaigns with labels/NAME.json. answers: folder for what is said; what is there stays.
    withhold: take the labelled effect out of the library. singles_only: leave out no or several effects, and unlisted
    ones. count: of campaigns, the first ones; None for all."""

    campaigns: Path
    answers: Path
    withhold: bool = False
    singles_only: bool = False
    count: int | None = None
    most_effects: int = 2


@dataclass(frozen=True)
class Job:
    asked: Asked
    name: str

    @property
    def label(self) -> Path:
        return self.asked.campaigns / "labels" / f"{self.name}.json"

    @property
    def target(self) -> Path:
        return self.asked.answers / f"{self.name}.json"


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
    asked = Asked(given.campaigns, given.out, given.withhold, given.singles_only, given.count, given.max_effects)
    answer_all(asked, given.processes)


def answer_all(asked: Asked, processes: int) -> None:
    """Diagnoses what has no answer yet, a line each as it is done."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read by the processes as they start
    labels = sorted((asked.campaigns / "labels").glob("*.json"))[: asked.count]
    jobs = [job for job in (Job(asked, label.stem) for label in labels) if not job.target.exists()]
    if not jobs:
        return
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        for k, line in enumerate(pool.imap_unordered(_one, jobs), start=1):
            print(f"{k}/{len(jobs)} {line}", flush=True)


def _one(job: Job) -> str:
    asked, folder = job.asked, job.asked.campaigns / job.name
    effects = json.loads(job.label.read_text(encoding="utf-8"))["effects"]
    if asked.singles_only and (len(effects) != 1 or "unlisted" in effects[0]):
        return f"{folder.name}: left out"
    try:
        kept = answer(folder, job.label, effects if asked.withhold else (), asked.most_effects)
    except Exception:
        return f"{folder.name}: FAILED\n{traceback.format_exc()}"
    save(kept, job.target)
    return (
        f"{folder.name}: {'+'.join(effects) or 'none'} -> {kept.word} {'+'.join(kept.names)} "
        f"{kept.ranking[0][2]:.2f}; {kept.before:.2f} -> {kept.after:.2f}, noise {kept.noise:.2f}; {kept.cpu_s:.0f} s"
    )


if __name__ == "__main__":
    main()
