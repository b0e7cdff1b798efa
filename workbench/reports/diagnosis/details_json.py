"""The further keys of diagnosis.json: the numbers of each step of the diagnosis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from workbench import __version__
from workbench.consequences import as_json
from workbench.core.json_records import plain
from workbench.diagnose.hypotheses.free_parameters import Estimate
from workbench.diagnose.location.records import Profile
from workbench.diagnose.records import Diagnosis
from workbench.diagnose.unexplained.records import Curve
from workbench.diagnose.verdict.answer import Candidate
from workbench.view.words import words_of

DIGITS = 5  # significant
ANGLE_DIGITS = 4


def details(d: Diagnosis) -> dict[str, Any]:
    """The keys after the fixed ones. Numbers that are not finite are null."""
    keys: dict[str, Any] = plain(
        {
            "sentence": d.verdict.sentence,
            "reasons": [
                {"kind": r.kind, "effects": r.effects, "value": r.value, "percent": r.percent}
                for r in d.verdict.reasons
            ],
            "warnings": d.warnings,
            "notes": d.campaign.all_notes,
            "machine": d.campaign.machine.name,
            "runs": [run.name for run in d.campaign.runs],
            "seed": d.seed,
            "version": __version__,
            "condition": _condition(d),
            "gap_details": _gap(d),
            "where_details": _where(d),
            "candidates": [_candidate(candidate) for candidate in d.candidates],
            "isolability": _isolability(d),
            "next_run_details": d.next_run and {"separation": d.next_run.separation, "separation_now": d.next_run.now},
            "shrink_details": {
                "by_run": {name: {"before": was, "after": now} for name, (was, now) in d.shrink.by_run.items()},
                "sentences": d.shrink.sentences,
            },
            "unknown": d.unknown
            and {"curves": [_curve(curve) for curve in d.unknown.curves], "sentences": d.unknown.sentences},
        },
        DIGITS,
    )
    return keys | {
        "consequences": None if d.consequences is None else as_json(d.consequences),
        "why_no_consequences": d.why_no_consequences,
    }


def estimates_json(parameters: Mapping[str, Sequence[Estimate]]) -> dict[str, dict[str, Any]]:
    """effect -> parameter -> value and standard error; lists where they are each run's own."""
    return {
        effect: {one.name: plain({"value": one.value, "std_error": one.std_error}, DIGITS) for one in estimates}
        for effect, estimates in parameters.items()
    }


def _condition(d: Diagnosis) -> dict[str, Any]:
    noise = f"noise_rms_{words_of(d.campaign.machine).suffix}"
    return {
        "band_hz": d.condition.band_hz,
        noise: d.condition.noise_rms,
        "runs": [_renamed(run, noise_rms=noise) for run in d.condition.runs],
        "sentences": d.condition.sentences,
    }


def _gap(d: Diagnosis) -> dict[str, Any]:
    g, w = d.gap, words_of(d.campaign.machine)
    name, size = g.worst_tolerance
    return {
        "significant": g.significant,
        "force_on_carriage_rms_n": g.force_rms_n,
        f"nominal_{w.quantity}_rms_{w.suffix}": g.nominal_residual_rms,
        "nominal_speed_rmse_percent": g.nominal_speed_rmse_percent,
        "worst_tolerance": {"key": name, "tolerances": size},
        "sentences": g.sentences,
    }


def _where(d: Diagnosis) -> dict[str, Any] | None:
    w = d.where
    if w is None:
        return None
    return {
        "share_interval": w.interval,
        "side": w.side,
        "energy_by_run": w.energy_by_run,
        "profiles": [_profile(profile) for profile in w.profiles],
        "sentences": w.sentences,
    }


def _profile(profile: Profile) -> dict[str, Any]:
    return {name: value for name, value in vars(profile).items() if name != "label"}


def _candidate(candidate: Candidate) -> dict[str, Any]:
    c = candidate
    return {
        "effects": c.effects,
        "gain": c.gain,
        "merit": c.evidence,
        "residual_rms": c.residual_rms,
        "held_out_rms": c.held_out_rms,
        "explained": c.explained,
        "fitted": c.fitted,
        "parameters": estimates_json(c.parameters),
        "against": c.against,
        "failure": c.failure,
    }


def _isolability(d: Diagnosis) -> dict[str, Any]:
    i = d.isolability
    return {
        "names": i.names,
        "angle_deg": plain(i.angle, ANGLE_DIGITS),
        "smallest_visible": {
            name: {"parameter": parameter, "value": size} for name, (parameter, size) in i.visible.items()
        },
        "sentences": i.sentences,
    }


def _curve(curve: Curve) -> dict[str, Any]:
    return _renamed(curve, std_forward="std_error_forward", std_backward="std_error_backward")


def _renamed(record: object, **names: str) -> dict[str, Any]:
    """A record's fields, some under another name."""
    return {names.get(name, name): value for name, value in vars(record).items()}
