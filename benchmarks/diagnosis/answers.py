"""One campaign diagnosed and kept: what scoring, and weighing anew with other numbers, need of it."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from workbench.diagnose.diagnose import Diagnosis, chosen_effects, diagnose
from workbench.diagnose.verdict.judge import ranked_merits, same_but_freer
from workbench.errors import InputError
from workbench.logs import read_campaign
from workbench.plants import plant_of


@dataclass(frozen=True)
class Answer:
    """A campaign's label, and the diagnosis' answer beside what it weighed.

    word: the verdict, or "refused" where it took the runs for unfit; `warnings` says why.
    weighed: a row for each hypothesis: names, merit, and how it fits. counted: names and merit of those that took part
    in the ranking, no names for what speaks for an unknown cause. evidence: what speaks for one besides. estimates:
    effect -> name -> (value, standard error). places: subsystem and probability. explained: share of the gap's energy.
    left: rms, percent_of_input, relevant. events: run, from_s, to_s of each that the answer says.
    """

    folder: str
    withheld: tuple[str, ...]
    label: dict[str, Any]
    word: str
    names: tuple[str, ...]
    alike: tuple[str, ...]
    ranking: list[tuple[str, list[str], float]]
    weighed: list[dict[str, Any]]
    counted: list[tuple[list[str], float]]
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
    kind: str = ""
    places: list[tuple[str, float]] = field(default_factory=list)
    events: list[tuple[str, float, float]] = field(default_factory=list)
    explained: float | None = None
    left: dict[str, Any] | None = None
    warnings: tuple[str, ...] = ()


def answer(folder: Path, label: Path, withheld: Sequence[str] = (), most_effects: int = 2) -> Answer:
    """Diagnose one campaign; `withheld` effects are taken out of the library first, and laws that hold them."""
    campaign = read_campaign(folder)
    kind = plant_of(campaign.machine).kind
    names = [effect.id for effect in chosen_effects(campaign, None)]
    gone = {name for name in names if any(name == one or same_but_freer(name, one, kind) for one in withheld)}
    listed = [name for name in names if name not in gone]
    cpu, wall = time.process_time(), time.monotonic()
    try:
        diagnosis = diagnose(campaign, candidates=listed if withheld else None, most_effects=most_effects, study=False)
    except InputError as error:
        return _refused(
            folder,
            label,
            tuple(withheld),
            str(error),
            kind.partition("-")[0],
            time.process_time() - cpu,
            time.monotonic() - wall,
        )
    return _kept(diagnosis, folder, label, tuple(withheld), time.process_time() - cpu, time.monotonic() - wall)


def _refused(
    folder: Path, label: Path, withheld: tuple[str, ...], why: str, kind: str, cpu: float, wall: float
) -> Answer:
    told = json.loads(label.read_text(encoding="utf-8"))
    told.pop("truth", None)
    return Answer(
        folder=folder.name, withheld=withheld, label=told, word="refused", names=(), alike=(),
        ranking=[("refused", [], 1.0)], weighed=[], counted=[], evidence={}, estimates={}, before=0.0, after=0.0,
        noise=0.0, kind=kind, subsystem="", regime="", windows=[], cpu_s=cpu, wall_s=wall, warnings=(why,),
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
        weighed=[_weighed(w, len(d.found.base.z)) for w in d.judged.weighed],
        counted=[(list(names), merit) for names, merit in ranked_merits(d.judged.weighed, d.judged.best)],
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
        kind=str(told.get("kind") or plant_of(d.campaign.machine).kind.partition("-")[0]),
        places=[(place.subsystem, place.probability) for place in (d.where.places if d.where else ())],
        events=[(event.run, event.from_s, event.to_s) for event in (d.where.events if d.where else ())],
        explained=d.verdict.explained,
        left=asdict(d.verdict.left),
        warnings=tuple(map(str, d.warnings)),
    )


def _weighed(w: Any, base: int) -> dict[str, Any]:
    """base: number of the machine's own parameters in every fit."""
    return {
        "names": [] if w.rival else list(w.names),
        "merit": w.merit,
        "fit": list(w.names),
        "chi2": w.fit.chi2,
        "prior": w.fit.prior,
        "parameters": len(w.fit.z) - base,
    }


def save(kept: Answer, file: Path) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_suffix(".part")
    part.write_text(json.dumps(asdict(kept), default=float), encoding="utf-8")
    part.replace(file)


def load(folder: Path) -> list[dict[str, Any]]:
    """All answers of a folder, in the order of their names; `source` is the folder's name."""
    files = sorted(folder.glob("*.json"))
    return [{"source": folder.name, **json.loads(file.read_text(encoding="utf-8"))} for file in files]
