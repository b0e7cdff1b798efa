"""diagnosis.json: the keys that the outside world reads, in their order; behind them what else was found."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from workbench.diagnose.records import Diagnosis
from workbench.reports.diagnosis.hypotheses import chosen_candidate
from workbench.reports.diagnosis.more_json import estimates_json, more
from workbench.reports.numbers import rounded
from workbench.reports.words import words_of

DIGITS = 5  # significant
PARTS = 10**5  # that probabilities are counted in


def to_json(d: Diagnosis) -> dict[str, Any]:
    """All of diagnosis.json. What is no finite number is null."""
    v, s, g = d.verdict, d.shrink, d.gap
    w = words_of(d.campaign.machine)
    fixed: dict[str, Any] = {
        "format": 1,
        "campaign": d.campaign.name,
        "verdict": v.word,
        "effects": list(v.effects),
        "ranking": [
            {"verdict": each.verdict, "effects": list(each.effects), "probability": p}
            for each, p in zip(v.ranking, probabilities([each.probability for each in v.ranking]), strict=True)
        ],
        "alike": list(v.alike),
        "next_run": _next_run(d),
        "where": _where(d),
        "parameters": _parameters(d),
        "explained": _digits(v.explained),
        "left": {
            "rms": _digits(v.left.rms),
            "percent_of_input": _digits(v.left.percent_of_input),
            "relevant": v.left.relevant,
        },
        "places": []
        if d.where is None
        else [{"subsystem": p.subsystem, "probability": _digits(p.probability)} for p in d.where.places],
        "gap": {
            f"{w.quantity}_rms_{w.suffix}": _digits(g.residual_rms),
            f"noise_rms_{w.suffix}": _digits(g.noise_rms),
            "band_hz": _digits(g.band_hz),
            "speed_rmse_percent": _digits(g.speed_rmse_percent),
        },
        "shrink": {
            "before": _digits(s.before),
            "after": _digits(s.after),
            "noise": _digits(s.noise),
            "unit": s.unit,
            "band_hz": _digits(s.band_hz),
            "factor": _digits(s.factor),
            "ci95": [_digits(bound) for bound in s.ci95],
            "speed_rmse_percent_before": _digits(s.speed_rmse_percent_before),
            "speed_rmse_percent_after": _digits(s.speed_rmse_percent_after),
        },
    }
    return fixed | more(d)


def probabilities(exact: Sequence[float]) -> list[float]:
    """Rounded to five decimals, order kept, and still 1 together: what rounding down loses goes to the nearest ones.

    ValueError where they are no probabilities at all.
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


def _next_run(d: Diagnosis) -> dict[str, Any] | None:
    n = d.next_run
    if n is None:
        return None
    return {"why": n.why, "payload_kg": _digits(n.payload_kg), "profile": n.profile, "signals": list(n.signals)}


def _where(d: Diagnosis) -> dict[str, Any] | None:
    w = d.where
    if w is None:
        return None
    return {
        "subsystem": w.subsystem,
        "regime": w.regime,
        "windows": [
            {"run": each.run, "from_s": round(each.from_s, 3), "to_s": round(each.to_s, 3)} for each in w.windows
        ],
        "share": _digits(w.share),
    }


def _parameters(d: Diagnosis) -> Mapping[str, Mapping[str, Any]]:
    """Of the named effects."""
    chosen = chosen_candidate(d)
    return {} if chosen is None else estimates_json(chosen.parameters)


def _digits(value: float) -> float | None:
    return rounded(value, DIGITS)
