"""`python -m benchmarks.many_causes FOLDER --many 3 --seed 9811`: three and four causes at once, blind.

Each campaign is drawn with so many listed causes of different subsystems, no two alike by nature, and is searched and
judged as the command does by default. An answer that is there is kept.
"""

from __future__ import annotations

import argparse
import json
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.validation.campaign import make_campaign
from benchmarks.validation.content import kind_of
from benchmarks.validation.entry import content_of
from benchmarks.validation.families import FAMILIES, Family
from benchmarks.validation.hoist_causes import ALIKE
from workbench.blind.make import mapped
from workbench.blind.run import save
from workbench.blind.seal import Order
from workbench.diagnose.diagnose import chosen_effects
from workbench.diagnose.hypotheses.free_parameters import base_parameters
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.search import SearchResult, searched
from workbench.diagnose.readiness.noise import with_motion_noise
from workbench.diagnose.verdict.judge import alike, judged_to_help
from workbench.effects import effects_for
from workbench.logs import Campaign, read_campaign
from workbench.simulate.noise import usable_band

HOISTS = ("hoist_practice", "hoist_double", "hoist_small", "hoist_middle", "hoist_large")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--many", type=int, nargs="+", default=[3, 4])
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--cases", type=int, default=10, help="of each number of causes")
    parser.add_argument("--families", nargs="+", default=HOISTS)
    parser.add_argument("--processes", type=int, default=1)
    given = parser.parse_args()
    orders = [
        drawn(given.seed, n, many, FAMILIES[given.families[n % len(given.families)]])
        for many in given.many
        for n in range(given.cases)
    ]
    with mapped(given.processes) as over:
        for line in over(partial(answered, given.folder), orders):
            print(line, flush=True)
    rows = [json.loads(file.read_text(encoding="utf-8")) for file in sorted(given.folder.glob("*.json"))]
    for many in given.many:
        print(summary([row for row in rows if len(row["true"]) == many], many))


def drawn(seed: int, number: int, many: int, family: Family) -> Order:
    """The order of one campaign: causes of different subsystems, no two of them alike by nature."""
    rng, kind = np.random.default_rng([seed, many, number, 7]), kind_of(family)
    while True:
        names = tuple(map(str, rng.choice(kind.usual, many, replace=False)))
        if not any(len({*names} & group) > 1 for group in ALIKE):
            order = Order(number, (seed, many, number), "simulator", family.name, "singles", names)
            if len({cause.subsystem for cause in content_of(order).causes}) == many:
                return order


def answered(folder: Path, order: Order) -> str:
    file = folder / f"{len(order.names)}_{order.number:02d}.json"
    campaign = file.with_suffix("")
    if not file.exists():
        if not campaign.exists():
            make_campaign(campaign, order.seed, content_of(order))
        save(json.dumps(answer(campaign, order)), file)
    row = json.loads(file.read_text(encoding="utf-8"))
    return f"{file.stem} {row['family']}: {'+'.join(row['true'])} -> {row['word']} {'+'.join(row['named'])}; " + (
        f"{'right' if right(row) else 'missed ' + ', '.join(missed(row)) + '; false ' + ', '.join(false(row))}; "
        f"{row['cpu_s']:.0f} s"
    )


def answer(folder: Path, order: Order) -> dict[str, Any]:
    begun, campaign = time.process_time(), read_campaign(folder)
    search = search_of(campaign)
    judged = judged_to_help(search)
    return {
        "family": order.family, "true": sorted(order.names), "word": judged.word, "named": list(judged.names),
        "alike": list(alike(search, judged)), "twins": [list(n) for n in judged.ranking[0].twins],
        "probability": judged.ranking[0].probability, "cpu_s": time.process_time() - begun,
    }  # fmt: skip


def problem_of(campaign: Campaign, band_hz: float | None = None) -> Problem:
    """As `workbench diagnose` poses it."""
    problem = Problem(campaign.machine, campaign.runs, band_hz)
    if band_hz is None:
        problem = Problem(campaign.machine, campaign.runs, usable_band(problem.bench))
    return with_motion_noise(problem, 0)


def search_of(campaign: Campaign) -> SearchResult:
    """The search of `workbench diagnose`, without what follows the verdict."""
    problem = problem_of(campaign)
    others = [effect for effect in effects_for(problem.active.kind).values() if not effect.listed]
    keys = base_parameters(campaign.machine, campaign.runs)
    return searched(problem, chosen_effects(campaign, None), rivals=others, base=keys)


def missed(row: dict[str, Any]) -> list[str]:
    return sorted(set(row["true"]) - set(row["named"]))


def false(row: dict[str, Any]) -> list[str]:
    """Named, and not in the machine."""
    return sorted(set(row["named"]) - set(row["true"]))


def right(row: dict[str, Any]) -> bool:
    """All, and no other, perhaps by a twin's name."""
    return any(set(row["true"]) == set(names) for names in (row["named"], *row["twins"]))


def summary(rows: list[dict[str, Any]], many: int) -> str:
    whole = sum(map(right, rows))
    wrong = sum(bool(false(row)) and not right(row) for row in rows)
    named = sum(many - len(missed(row)) for row in rows)
    text = f"{many} causes: all right {whole} of {len(rows)}, a false one {wrong}"
    return f"{text}; of all causes {named} of {many * len(rows)}"


if __name__ == "__main__":
    main()
