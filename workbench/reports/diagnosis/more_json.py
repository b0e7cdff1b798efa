"""What diagnosis.json says beside its fixed keys: each step of the diagnosis in numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from workbench import __version__
from workbench.consequences import as_json
from workbench.diagnose.records import Candidate, Curve, Diagnosis, Estimate, Profile
from workbench.reports.numbers import rounded
from workbench.reports.words import words_of
from workbench.run import Array

DIGITS = 5


def more(d: Diagnosis) -> dict[str, Any]:
    """Keys that stand behind the fixed ones."""
    return {
        "sentence": d.verdict.sentence,
        "reasons": [
            {"kind": r.kind.value, "effects": list(r.effects), "value": _digits(r.value), "percent": _digits(r.percent)}
            for r in d.verdict.reasons
        ],
        "warnings": list(d.warnings),
        "notes": list(d.campaign.all_notes),
        "machine": d.campaign.machine.name,
        "runs": [run.name for run in d.campaign.runs],
        "seed": d.seed,
        "version": __version__,
        "condition": _condition(d),
        "gap_details": _gap(d),
        "where_details": _where(d),
        "candidates": [_candidate(each) for each in d.candidates],
        "isolability": _isolability(d),
        "next_run_details": None
        if d.next_run is None
        else {"separation": _digits(d.next_run.separation), "separation_now": _digits(d.next_run.now)},
        "shrink_details": {
            "by_run": {
                name: {"before": _digits(was), "after": _digits(now)} for name, (was, now) in d.shrink.by_run.items()
            },
            "sentences": list(d.shrink.sentences),
        },
        "unknown": None
        if d.unknown is None
        else {
            "curves": [_curve(each) for each in d.unknown.curves],
            "sentences": list(d.unknown.sentences),
        },
        "consequences": None if d.consequences is None else as_json(d.consequences),
        "why_no_consequences": d.why_no_consequences,
    }


def estimates_json(parameters: Mapping[str, Sequence[Estimate]]) -> dict[str, dict[str, Any]]:
    """effect -> parameter -> value and standard error; lists where they are each run's own."""
    return {
        effect: {
            each.name: {"value": _each(each.value), "std_error": _each(each.std_error)} for each in estimates
        }
        for effect, estimates in parameters.items()
    }  # fmt: skip


def _condition(d: Diagnosis) -> dict[str, Any]:
    c, suffix = d.condition, words_of(d.campaign.machine).suffix
    return {
        "band_hz": _digits(c.band_hz),
        f"noise_rms_{suffix}": _digits(c.noise_rms),
        "runs": [
            {
                "name": run.name,
                "samples": run.samples,
                "sample_time_s": _digits(run.sample_time_s),
                f"noise_rms_{suffix}": _digits(run.noise_rms),
                "moving_share": _digits(run.moving_share),
                "clipped_share": _digits(run.clipped_share),
                "outliers": run.outliers,
                "delay_s": None if run.delay_s is None else _digits(run.delay_s),
                "notes": list(run.notes),
            }
            for run in c.runs
        ],
        "sentences": list(c.sentences),
    }


def _gap(d: Diagnosis) -> dict[str, Any]:
    g, w = d.gap, words_of(d.campaign.machine)
    name, size = g.worst_tolerance
    return {
        "significant": g.significant,
        "force_on_carriage_rms_n": None if g.force_rms_n is None else _digits(g.force_rms_n),
        f"nominal_{w.quantity}_rms_{w.suffix}": _digits(g.nominal_residual_rms),
        "nominal_speed_rmse_percent": _digits(g.nominal_speed_rmse_percent),
        "worst_tolerance": {"key": name, "tolerances": _digits(size)},
        "sentences": list(g.sentences),
    }


def _where(d: Diagnosis) -> dict[str, Any] | None:
    w = d.where
    if w is None:
        return None
    return {
        "share_interval": _list(w.interval),
        "side": w.side,
        "energy_by_run": {name: _digits(share) for name, share in w.energy_by_run.items()},
        "profiles": [_profile(each) for each in w.profiles],
        "sentences": list(w.sentences),
    }


def _profile(each: Profile) -> dict[str, Any]:
    return {
        "variable": each.variable,
        "unit": each.unit,
        "regime": each.regime,
        "edges": _list(each.edges),
        "mean_forward": _list(each.mean_forward),
        "mean_backward": _list(each.mean_backward),
        "share": _list(each.share),
        "explains": _digits(each.explains),
        "interval": _list(each.interval),
    }


def _candidate(each: Candidate) -> dict[str, Any]:
    return {
        "effects": list(each.effects),
        "gain": _digits(each.gain),
        "merit": _digits(each.merit),
        "residual_rms": _maybe(each.residual_rms),
        "held_out_rms": _maybe(each.held_out_rms),
        "explained": _maybe(each.explained),
        "fitted": each.fitted,
        "parameters": estimates_json(each.parameters),
        "against": list(each.against),
        "failure": each.failure,
    }


def _isolability(d: Diagnosis) -> dict[str, Any]:
    i = d.isolability
    return {
        "names": list(i.names),
        "angle_deg": [[rounded(float(a), 4) for a in row] for row in i.angle],
        "smallest_visible": {
            name: {"parameter": parameter, "value": _digits(size)} for name, (parameter, size) in i.visible.items()
        },
        "sentences": list(i.sentences),
    }


def _curve(each: Curve) -> dict[str, Any]:
    return {
        "over": each.over,
        "acts_on": each.acts_on,
        "at": _list(each.at),
        "forward": _list(each.forward),
        "backward": _list(each.backward),
        "std_error_forward": _list(each.std_forward),
        "std_error_backward": _list(each.std_backward),
        "explains": _digits(each.explains),
    }


def _digits(value: float) -> float | None:
    return rounded(float(value), DIGITS)


def _maybe(value: float | None) -> float | None:
    return None if value is None else _digits(value)


def _list(values: Array | Sequence[float]) -> list[float | None]:
    return [_digits(value) for value in np.asarray(values, dtype=float)]


def _each(value: float | tuple[float, ...]) -> float | list[float | None] | None:
    return _list(value) if isinstance(value, tuple) else _digits(value)
