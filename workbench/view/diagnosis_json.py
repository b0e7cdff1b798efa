"""diagnosis.json: the public keys in their order, then the numbers of each step."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from workbench import __version__
from workbench.core.json_records import plain
from workbench.diagnose.diagnose import Diagnosis
from workbench.diagnose.hypotheses.free_parameters import Estimate
from workbench.diagnose.isolation.planned import Planned
from workbench.study.consequences import as_json
from workbench.view.words import words_of

DIGITS = 5  # significant
ANGLE_DIGITS = 4
PARTS = 10**5  # that probabilities are counted in


def to_json(d: Diagnosis) -> dict[str, Any]:
    """The content of diagnosis.json. Numbers that are not finite are null."""
    return _answer(d) | _steps(d)


def _answer(d: Diagnosis) -> dict[str, Any]:
    v, g, where, w = d.verdict, d.gap, d.where, words_of(d.campaign.machine)
    law = None if d.unknown is None else d.unknown.law
    exact = probabilities([row.probability for row in v.ranking])
    said = {
        "format": 1,
        "campaign": d.campaign.name,
        "verdict": v.word,
        "effects": v.effects,
        "ranking": [
            {"verdict": row.verdict, "effects": row.effects, "probability": p}
            | ({"twins": row.twins} if row.twins else {})
            for row, p in zip(v.ranking, exact, strict=True)
        ],
        "alike": v.alike,
        "next_run": d.next_run and {**_of(d.next_run, "why payload_kg profile signals"), **_moves(d.next_run.planned)},
        "where": where
        and {
            "subsystem": where.subsystem,
            "regime": where.regime,
            "windows": [
                {"run": window.run, "from_s": round(window.from_s, 3), "to_s": round(window.to_s, 3)}
                for window in where.windows
            ],
            "share": where.share,
        },
        "parameters": _estimates(d.chosen.parameters) if d.chosen else {},
        "explained": v.explained,
        "left": _of(v.left, "rms percent_of_input relevant"),
        "remainder": v.remainder and vars(v.remainder),
        "places": [_of(place, "subsystem probability") for place in (where.places if where else ())],
        "gap": {
            f"{w.quantity}_rms_{w.suffix}": g.residual_rms,
            f"noise_rms_{w.suffix}": g.noise_rms,
            "band_hz": g.band_hz,
            "speed_rmse_percent": g.speed_rmse_percent,
        },
        "shrink": _without(d.shrink, "by_run", "sentences"),
        "delivered": {
            **_without(d.delivered, "runs", "validated"),
            "band_hz": g.band_hz,
            "runs": list(map(vars, d.delivered.runs)),
            "validated": list(map(vars, d.delivered.validated)),
        },
        "steps": list(map(vars, v.steps)),
        "law": law
        and {
            "equation": law.equation,
            "acts_on": law.acts_on,
            "unit": law.unit,
            "values": {name: {"value": a, "std_error": error, "unit": unit} for name, a, error, unit in law.values},
            **_of(law, "before after explains rms"),
        },
        "unlisted": {} if d.unknown is None else d.unknown.effects,
    }
    # Times of windows have their own rounding: milliseconds.
    return plain(said, DIGITS) | {"where": _kept_times(plain(said["where"], DIGITS), said["where"])}


def _kept_times(rounded: Any, exact: Any) -> Any:
    return rounded and rounded | {"windows": exact["windows"]}


def _moves(planned: Planned | None) -> dict[str, Any]:
    if planned is None:
        return {}
    moves = [{key: value for key, value in vars(step).items() if value is not None} for step in planned.steps]
    return {"start_position": planned.start_position, "speed": planned.limits.speed_m_s, "moves": moves}


def _steps(d: Diagnosis) -> dict[str, Any]:
    """The keys after the fixed ones."""
    g, w, i, where = d.gap, words_of(d.campaign.machine), d.isolability, d.where
    noise = f"noise_rms_{w.suffix}"
    keys = {
        "sentence": d.verdict.sentence,
        "reasons": [_of(reason, "kind effects value percent") for reason in d.verdict.reasons],
        "warnings": d.warnings,
        "notes": d.campaign.all_notes,
        "machine": d.campaign.machine.name,
        "runs": [run.name for run in d.campaign.runs],
        "seed": d.seed,
        "version": __version__,
        "condition": {
            "band_hz": d.condition.band_hz,
            noise: d.condition.noise_rms,
            "runs": [_renamed(run, noise_rms=noise) for run in d.condition.runs],
            "sentences": d.condition.sentences,
        },
        "gap_details": {
            "significant": g.significant,
            "force_on_carriage_rms_n": g.force_rms_n,
            f"nominal_{w.quantity}_rms_{w.suffix}": g.nominal_residual_rms,
            "nominal_speed_rmse_percent": g.nominal_speed_rmse_percent,
            "worst_tolerance": dict(zip(("key", "tolerances"), g.worst_tolerance, strict=True)),
            "sentences": g.sentences,
        },
        "where_details": where
        and {
            "share_interval": where.interval,
            **_of(where, "side energy_by_run"),
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
            "angle_deg": plain(i.angle, ANGLE_DIGITS),
            "smallest_visible": {
                name: {"parameter": parameter, "value": size} for name, (parameter, size) in i.visible.items()
            },
            "sentences": i.sentences,
        },
        "next_run_details": d.next_run
        and {
            "separation": d.next_run.separation,
            "separation_now": d.next_run.now,
            "separation_menu": d.next_run.menu,
            "decides": d.next_run.decides,
        },
        "shrink_details": {
            "by_run": {name: {"before": was, "after": now} for name, (was, now) in d.shrink.by_run.items()},
            "sentences": d.shrink.sentences,
        },
        "residual_tests": [
            _without(test, "correlations")
            | {"correlations": {name: vars(correlation) for name, correlation in test.correlations.items()}}
            for test in d.residual_tests
        ],
        "unknown": d.unknown
        and {
            "curves": [
                _renamed(curve, std_forward="std_error_forward", std_backward="std_error_backward")
                for curve in d.unknown.curves
            ],
            "sentences": d.unknown.sentences,
        },
    }
    return plain(keys, DIGITS) | {
        "consequences": None if d.consequences is None else as_json(d.consequences),
        "why_no_consequences": d.why_no_consequences,
    }


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
    return {
        effect: {one.name: {"value": one.value, "std_error": one.std_error} for one in estimates}
        for effect, estimates in parameters.items()
    }


def _of(record: object, names: str) -> dict[str, Any]:
    return {name: getattr(record, name) for name in names.split()}


def _without(record: object, *names: str) -> dict[str, Any]:
    return {name: value for name, value in vars(record).items() if name not in names}


def _renamed(record: object, **names: str) -> dict[str, Any]:
    """A record's fields, some under another name."""
    return {names.get(name, name): value for name, value in vars(record).items()}
