"""One campaign diagnosed and kept: what scoring, and weighing anew with other numbers, need of it."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from workbench.diagnose.diagnose import Diagnosis, chosen_effects, diagnose
from workbench.diagnose.verdict.judge import same_but_freer
from workbench.errors import InputError
from workbench.logs import read_campaign
from workbench.plants import plant_of


@dataclass(frozen=True)
class Answer:
    """A campaign's label, and the diagnosis' answer beside what it weighed.

    word: the verdict, or "refused" where it took the runs for unfit; `warnings` says why.
    weighed: a row for each hypothesis: names, merit, earned. misfit: clear, slow, and the tolerances' pull
    of the best hypothesis. estimates: effect -> name -> (value, standard error).
    """

    folder: str
    withheld: tuple[str, ...]
    label: dict[str, Any]
    word: str
    names: tuple[str, ...]
    alike: tuple[str, ...]
    ranking: list[tuple[str, list[str], float]]
    weighed: list[dict[str, Any]]
    evidence: dict[str, float]
    estimates: dict[str, dict[str, Any]]
    before: float
    after: float
    noise: float
    subsystem: str
    regime: str
    windows: list[tuple[str, float, float]]
    cpu_s: float
    wall_s: float
    warnings: tuple[str, ...] = field(default=())


def answer(folder: Path, label: Path, withheld: Sequence[str] = (), most_effects: int = 2) -> Answer:
    """Diagnose one campaign; `withheld` effects are taken out of the library first, and laws that hold them."""
    campaign = read_campaign(folder)
    kind = plant_of(campaign.machine).kind
    gone = set(withheld) | {
        each.id
        for each in chosen_effects(campaign, None)
        if any(same_but_freer(each.id, one, kind) for one in withheld)
    }
    listed = [each.id for each in chosen_effects(campaign, None) if each.id not in gone]
    cpu, wall = time.process_time(), time.monotonic()
    try:
        found = diagnose(campaign, candidates=listed if withheld else None, most_effects=most_effects, study=False)
    except InputError as error:
        return _refused(folder, label, tuple(withheld), str(error), time.process_time() - cpu, time.monotonic() - wall)
    return _kept(found, folder, label, tuple(withheld), time.process_time() - cpu, time.monotonic() - wall)


def _refused(folder: Path, label: Path, withheld: tuple[str, ...], why: str, cpu: float, wall: float) -> Answer:
    told = json.loads(label.read_text(encoding="utf-8"))
    told.pop("truth", None)
    return Answer(
        folder=folder.name, withheld=withheld, label=told, word="refused", names=(), alike=(),
        ranking=[("refused", [], 1.0)], weighed=[], evidence={}, estimates={}, before=0.0, after=0.0, noise=0.0,
        subsystem="", regime="", windows=[], cpu_s=cpu, wall_s=wall, warnings=(why,),
    )  # fmt: skip


def _kept(d: Diagnosis, folder: Path, label: Path, withheld: tuple[str, ...], cpu: float, wall: float) -> Answer:
    told = json.loads(label.read_text(encoding="utf-8"))
    told.pop("truth", None)
    return Answer(
        folder=folder.name,
        withheld=withheld,
        label=told,
        word=d.verdict.word,
        names=d.verdict.effects,
        alike=d.verdict.alike,
        ranking=[(row.verdict, list(row.effects), row.probability) for row in d.verdict.ranking[:8]],
        weighed=[
            {
                "names": [] if w.rival else list(w.names),
                "merit": w.merit,
                "earned": w.earned,
                "fit": list(w.names),
                "chi2": w.fit.chi2,
                "prior": w.fit.prior,
                "parameters": len(w.fit.z) - len(d.found.base.z),
            }
            for w in d.judged.weighed
        ],
        evidence=dict(d.judged.evidence),
        estimates={
            name: {e.name: (e.value, e.std_error) for e in rows}
            for name, rows in (d.candidates[0].parameters if d.candidates else {}).items()
        },
        before=d.shrink.before,
        after=d.shrink.after,
        noise=d.shrink.noise,
        subsystem=d.where.subsystem if d.where else "",
        regime=d.where.regime if d.where else "",
        windows=[(w.run, w.from_s, w.to_s) for w in d.where.windows] if d.where else [],
        cpu_s=cpu,
        wall_s=wall,
        warnings=d.warnings,
    )


def save(kept: Answer, file: Path) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_suffix(".part")
    part.write_text(json.dumps(asdict(kept), default=float), encoding="utf-8")
    part.replace(file)


def load(folder: Path) -> list[dict[str, Any]]:
    """All answers of a folder, in the order of their names."""
    return [json.loads(file.read_text(encoding="utf-8")) for file in sorted(folder.glob("*.json"))]
