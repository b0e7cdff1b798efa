"""diagnosis.json: the public keys in their order, then the numbers of each step."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from workbench import __version__
from workbench.core.json_records import plain
from workbench.diagnose.diagnose import Diagnosis
from workbench.diagnose.hypotheses.free_parameters import Estimate
from workbench.machines import kind_of

DIGITS = 5  # significant
ANGLE_DIGITS = 4
PARTS = 10**5  # that probabilities are counted in


def to_json(d: Diagnosis) -> dict[str, Any]:
    """The content of diagnosis.json. Numbers that are not finite are null."""
    said: dict[str, Any] = plain(_answer(d) | _steps(d), DIGITS)
    said["isolability"]["angle_deg"] = plain(d.isolability.angle, ANGLE_DIGITS)
    if d.where is not None:  # times are rounded to milliseconds
        said["where"]["windows"] = [
            {"run": w.run, "from_s": round(w.from_s, 3), "to_s": round(w.to_s, 3)} for w in d.where.windows
        ]
    said |= {"consequences": None, "why_no_consequences": d.why_no_consequences}
    if d.consequences is not None:
        from workbench.study.consequences import as_json

        said["consequences"] = as_json(d.consequences)
    return said


def _answer(d: Diagnosis) -> dict[str, Any]:
    """The fixed keys."""
    v, g, w = d.verdict, d.gap, kind_of(d.campaign.machine).drive
    law = None if d.unknown is None else d.unknown.law
    ranking = zip(v.ranking, probabilities([row.probability for row in v.ranking]), strict=True)
    next_run = d.next_run and _of(d.next_run, "why payload_kg profile signals")
    if next_run and d.next_run and d.next_run.planned:
        next_run |= d.next_run.planned.motion
    return {
        "format": 1,
        "campaign": d.campaign.name,
        "verdict": v.word,
        "effects": v.effects,
        "ranking": [
            _of(row, "verdict effects") | {"probability": p} | ({"twins": row.twins} if row.twins else {})
            for row, p in ranking
        ],
        "alike": v.alike,
        "next_run": next_run,
        "where": d.where and _of(d.where, "subsystem regime windows share"),
        "parameters": _estimates(d.chosen.parameters) if d.chosen else {},
        "explained": v.explained,
        "left": _of(v.left, "rms percent_of_input relevant"),
        "remainder": v.remainder and vars(v.remainder),
        "places": [_of(place, "subsystem probability") for place in (d.where.places if d.where else ())],
        "gap": {f"{w.quantity}_rms_{w.suffix}": g.residual_rms, f"noise_rms_{w.suffix}": g.noise_rms,
                **_of(g, "band_hz speed_rmse_percent")},
        "shrink": _without(d.shrink, "by_run sentences"),
        "delivered": _of(d.delivered, "residual_rms speed_rmse_percent") | {"band_hz": g.band_hz}
        | {name: list(map(vars, getattr(d.delivered, name))) for name in ("runs", "validated")},
        "steps": list(map(vars, v.steps)),
        "law": law and {
            **_of(law, "equation acts_on unit"),
            "values": {name: {"value": a, "std_error": error, "unit": unit} for name, a, error, unit in law.values},
            **_of(law, "before after explains rms"),
        },
        "unlisted": {name: d.corrected.effects[name] for name in v.beside} if d.unknown is None else d.unknown.effects,
    }  # fmt: skip


def _steps(d: Diagnosis) -> dict[str, Any]:
    """The keys after the fixed ones."""
    g, w, i, where, n, s = d.gap, kind_of(d.campaign.machine).drive, d.isolability, d.where, d.next_run, d.shrink
    noise, errors = f"noise_rms_{w.suffix}", {"std_forward": "std_error_forward", "std_backward": "std_error_backward"}
    return {
        "sentence": d.verdict.sentence,
        "reasons": [_of(reason, "kind effects value percent over") for reason in d.verdict.reasons],
        "warnings": d.warnings,
        "notes": d.campaign.all_notes,
        "machine": d.campaign.machine.name,
        "runs": [run.name for run in d.campaign.runs],
        "seed": d.seed,
        "version": __version__,
        "condition": {"band_hz": d.condition.band_hz, noise: d.condition.noise_rms,
                      "runs": [_renamed(run, {"noise_rms": noise}) for run in d.condition.runs],
                      "sentences": d.condition.sentences},
        "gap_details": {
            "significant": g.significant,
            "force_on_carriage_rms_n": g.force_rms_n,
            f"nominal_{w.quantity}_rms_{w.suffix}": g.nominal_residual_rms,
            "nominal_speed_rmse_percent": g.nominal_speed_rmse_percent,
            "worst_tolerance": dict(zip(("key", "tolerances"), g.worst_tolerance, strict=True)),
            "sentences": g.sentences,
        },
        "where_details": where and {
            "share_interval": where.interval,
            "side": where.side,
            "energy_by_run": {run.name: run.share for run in d.delivered.runs},
            "profiles": [_without(profile, "label") for profile in where.profiles],
            "sentences": where.sentences,
        },
        "candidates": [
            _of(c, "effects gain merit residual_rms held_out_rms explained fitted")
            | {"parameters": _estimates(c.parameters), "against": c.against, "failure": c.failure}
            for c in d.candidates
        ],
        "isolability": {
            "names": i.names,
            "angle_deg": None,
            "smallest_visible": {name: {"parameter": key, "value": size} for name, (key, size) in i.visible.items()},
            "sentences": i.sentences,
        },
        "next_run_details": n
        and {"separation": n.separation, "separation_now": n.now, "separation_menu": n.menu, "decides": n.decides},
        "shrink_details": {
            "by_run": {name: {"before": was, "after": now} for name, (was, now) in s.by_run.items()},
            "sentences": s.sentences,
        },
        "residual_tests": [
            vars(test) | {"correlations": {name: vars(one) for name, one in test.correlations.items()}}
            for test in d.residual_tests
        ],
        "unknown": d.unknown
        and {"curves": [_renamed(c, errors) for c in d.unknown.curves], "sentences": d.unknown.sentences},
    }  # fmt: skip


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


def _estimates(parameters: Mapping[str, Sequence[Estimate]]) -> dict[str, dict[str, Any]]:
    """effect -> parameter -> value and standard error; lists where they are each run's own."""
    return {name: {one.name: _of(one, "value std_error") for one in found} for name, found in parameters.items()}


def _of(record: object, names: str) -> dict[str, Any]:
    return {name: getattr(record, name) for name in names.split()}


def _without(record: object, names: str) -> dict[str, Any]:
    return {name: value for name, value in vars(record).items() if name not in names.split()}


def _renamed(record: object, names: Mapping[str, str]) -> dict[str, Any]:
    return {names.get(name, name): value for name, value in vars(record).items()}
