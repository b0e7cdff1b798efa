"""`python -m benchmarks.next_runs FOLDER --seed 9811`: whether the recommended run settles what a campaign leaves open.

Short campaigns of one listed cause are drawn. Where the diagnosis leaves the true cause and another one open and states
that a run decides, with a probability from ASKED on, that run is simulated on the same true machine and the campaign is
diagnosed with it, and again with the best plain run of the menu that takes no longer in its place. Settled: the true
cause alone, nothing open.
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.validation.campaign import make_campaign
from benchmarks.validation.content import Content, kind_of
from benchmarks.validation.entry import content_of
from benchmarks.validation.families import FAMILIES
from benchmarks.validation.next_run import extended
from workbench.blind.make import mapped
from workbench.blind.run import save
from workbench.blind.seal import Order
from workbench.diagnose.diagnose import Diagnosis, diagnose
from workbench.diagnose.isolation.next_run import SURE
from workbench.logs import read_campaign

ASKED = 0.5  # probability to decide, as stated, from which on a run is simulated
FAMILY = ("hoist_practice", "axis_std", "hoist_small", "axis_rates", "hoist_middle", "axis_encoder")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--cases", type=int, default=20, help="campaigns that are drawn")
    parser.add_argument("--runs", type=int, default=2, help="of each campaign")
    parser.add_argument("--families", nargs="+", default=FAMILY)
    parser.add_argument("--processes", type=int, default=1)
    given = parser.parse_args()
    orders = [drawn(given.seed, n, given.families[n % len(given.families)]) for n in range(given.cases)]
    with mapped(given.processes) as over:
        for line in over(partial(asked, given.folder, given.runs), orders):
            print(line, flush=True)
    rows = [json.loads(file.read_text(encoding="utf-8")) for file in sorted(given.folder.glob("*.json"))]
    for least in (SURE, ASKED):
        questions = [row for row in rows if "designed" in row and row["decides"] >= least]
        stated = np.mean([row["decides"] for row in questions] or [np.nan])
        print(f"probability stated {least:g} and more, {stated:.2f} on the mean")
        for run in ("designed", "plain"):
            ends = [row[run] for row in questions]
            print(
                f"{run}: {sum(end['settled'] for end in ends)} of {len(ends)} questions settled, "
                f"{sum(end['right'] for end in ends)} named right; separation "
                f"{np.median([end['separation'] for end in ends] or [np.nan]):.1f} at the median"
            )


def drawn(seed: int, number: int, family: str) -> Order:
    rng = np.random.default_rng([seed, number, 8])
    name = str(rng.choice(kind_of(FAMILIES[family]).usual))
    return Order(number, (seed, number), "simulator", family, "singles", (name,))


def asked(folder: Path, runs: int, order: Order) -> str:
    """One campaign, a line of what came of it; what is there is kept."""
    file = folder / f"{order.number:03d}.json"
    if not file.exists():
        save(json.dumps(_asked(file.with_suffix(""), runs, order), default=float), file)
    row = json.loads(file.read_text(encoding="utf-8"))
    ends = "; ".join(f"{k}: {'+'.join(row[k]['named'])} {'settled' if row[k]['settled'] else row[k]['open']}"
                     for k in ("designed", "plain") if k in row)  # fmt: skip
    return f"{file.stem} {order.family} {row['true']}: {row['said']}. {ends}"


def _asked(folder: Path, runs: int, order: Order) -> dict[str, Any]:
    whole, (true,) = content_of(order), order.names
    rng = np.random.default_rng([*order.seed, 9])
    few = sorted(rng.choice(len(whole.runs), min(runs, len(whole.runs)), replace=False))
    content = replace(whole, runs=tuple(whole.runs[k] for k in few))
    first = _diagnosed(folder / "before", order, content)
    more, said = first.next_run, first.verdict.sentence
    row: dict[str, Any] = {"family": order.family, "true": true, "said": said}
    if more is None:
        return row
    row |= {"now": more.now, "decides": more.decides, "why": more.why}
    if more.decides < ASKED or more.plain is None or more.planned is None or true not in more.why:
        return row  # no run decides, or the true cause is not among those that are open
    plain = more.plain.motion | {"payload_kg": more.plain.payload_kg, "signals": more.signals}
    for name, run, apart in (("designed", more.record, more.separation), ("plain", plain, more.menu)):
        row[name] = _with(folder / name, order, content, run, folder / "before", true) | {"separation": apart}
    return row


def _with(
    folder: Path, order: Order, content: Content, run: Mapping[str, Any], before: Path, true: str
) -> dict[str, Any]:
    d = _diagnosed(folder, order, extended(content, run, before))
    right = d.verdict.word == "named" and d.verdict.effects == (true,)
    open_ = d.next_run.why.partition(";")[0] if d.next_run else ""
    return {"named": d.verdict.effects or [d.verdict.word], "right": right, "settled": right and not open_,
            "alike": d.verdict.alike, "open": open_, "probability": d.verdict.probability}  # fmt: skip


def _diagnosed(folder: Path, order: Order, content: Content) -> Diagnosis:
    shutil.rmtree(folder, ignore_errors=True)
    make_campaign(folder, order.seed, content)
    return diagnose(read_campaign(folder), study=False)


if __name__ == "__main__":
    main()
