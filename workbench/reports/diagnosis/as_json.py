"""diagnosis.json: the public keys in their order, then the numbers of each step."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from workbench.core.json_records import plain, rounded
from workbench.diagnose.records import Diagnosis
from workbench.reports.diagnosis.details_json import details, estimates_json
from workbench.reports.diagnosis.hypotheses import chosen_candidate
from workbench.view.words import words_of

DIGITS = 5  # significant
PARTS = 10**5  # that probabilities are counted in


def to_json(d: Diagnosis) -> dict[str, Any]:
    """The content of diagnosis.json. Numbers that are not finite are null."""
    v, g = d.verdict, d.gap
    w = words_of(d.campaign.machine)
    exact = probabilities([row.probability for row in v.ranking])
    fixed: dict[str, Any] = {
        "format": 1,
        "campaign": d.campaign.name,
        "verdict": v.word,
        "effects": list(v.effects),
        "ranking": [
            {"verdict": row.verdict, "effects": list(row.effects), "probability": p}
            | ({"twins": [list(names) for names in row.non_identifiable]} if row.non_identifiable else {})
            for row, p in zip(v.ranking, exact, strict=True)
        ],
        "alike": list(v.alike),
        "next_run": _next_run(d),
        "where": _where(d),
        "parameters": _parameters(d),
        "explained": rounded(v.explained, DIGITS),
        "left": plain(
            {"rms": v.left.rms, "percent_of_input": v.left.percent_of_input, "relevant": v.left.relevant}, DIGITS
        ),
        "remainder": plain(vars(v.remainder), DIGITS) if v.remainder else None,
        "places": []
        if d.where is None
        else [{"subsystem": p.subsystem, "probability": rounded(p.probability, DIGITS)} for p in d.where.places],
        "gap": {
            f"{w.quantity}_rms_{w.suffix}": g.residual_rms,
            f"noise_rms_{w.suffix}": g.noise_rms,
            "band_hz": g.band_hz,
            "speed_rmse_percent": g.speed_rmse_percent,
        },
        "shrink": {name: value for name, value in vars(d.shrink).items() if name not in ("by_run", "sentences")},
    }
    fixed["delivered"] = plain(
        {
            "residual_rms": d.delivered.residual_rms,
            "speed_rmse_percent": d.delivered.speed_rmse_percent,
            "band_hz": g.band_hz,
            "runs": [vars(run) for run in d.delivered.runs],
        },
        DIGITS,
    )
    steps = {
        "steps": [
            plain({"effects": step.effects, "merit": step.evidence, "left_rms": step.left_rms}, DIGITS)
            for step in v.steps
        ]
    }
    return fixed | plain({key: fixed[key] for key in ("gap", "shrink")}, DIGITS) | steps | details(d)


def probabilities(exact: Sequence[float]) -> list[float]:
    """Rounded to five decimals with the same order and a sum of 1: the remainder goes to the values nearest to it.

    ValueError if they are not probabilities.
    """
    total = math.fsum(exact)
    if not (math.isfinite(total) and total > 0.0 and min(exact) >= 0.0):
        raise ValueError(f"the ranking's probabilities add up to {total}, one of them is {min(exact, default=0.0)}")
    scaled = [p / total * PARTS for p in exact]
    parts = [math.floor(x) for x in scaled]
    nearest_first = sorted(range(len(exact)), key=lambda i: (parts[i] - scaled[i], i))
    for i in nearest_first[: PARTS - sum(parts)]:
        parts[i] += 1
    return [part / PARTS for part in parts]


def _next_run(d: Diagnosis) -> Any:
    n = d.next_run
    return n and plain(
        {"why": n.why, "payload_kg": n.payload_kg, "profile": n.profile, "signals": n.signals}, DIGITS
    )  # fmt: skip


def _where(d: Diagnosis) -> dict[str, Any] | None:
    w = d.where
    if w is None:
        return None
    return {
        "subsystem": w.subsystem,
        "regime": w.regime,
        "windows": [
            {"run": window.run, "from_s": round(window.from_s, 3), "to_s": round(window.to_s, 3)}
            for window in w.windows
        ],
        "share": rounded(w.share, DIGITS),
    }


def _parameters(d: Diagnosis) -> Mapping[str, Mapping[str, Any]]:
    """Of the named effects."""
    chosen = chosen_candidate(d)
    return {} if chosen is None else estimates_json(chosen.parameters)
