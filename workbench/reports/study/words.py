"""The conclusions of a study's report: those of the study, and what they mean for drive, wire and duty cycle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from workbench.errors import InputError
from workbench.references import BASELINE, planned_kinds
from workbench.study.decide import verdict
from workbench.study.findings import alarm, sentences, utilisation
from workbench.study.labels import run_in_words, swept_axes
from workbench.study.load import plan_study
from workbench.study.rows import Row, metrics_of
from workbench.study.run import peak_limit
from workbench.study.scenario import Scenario
from workbench.study.side import from_the_bound, on_another_damping
from workbench.study.store import Finished


def conclusions(result: Finished) -> list[str]:
    """Plain sentences, the answer to the study's question first."""
    rows = result.rows
    good = [row for row in rows if row.ok]
    return [
        *(said for said in (verdict(rows), alarm(utilisation(rows, result.machine))) if said),
        *_asked_again(result),
        *_against_baseline(good, result.scenario),
        *sentences(rows, peak_limit(result.machine)),
        *_heat(good),
        *_power(good),
        *_wire(good),
    ]


def _asked_again(result: Finished) -> list[str]:
    """What another wire makes of it, and how far the references are from the least peak there is; [] where the scenario
    cannot be planned again from here."""
    try:
        study = plan_study(Scenario.model_validate(dict(result.scenario)), result.machine)
        damping = on_another_damping(study)
        return [*([damping] if damping else []), *from_the_bound(study)]
    except (InputError, ValidationError):
        return []


def _against_baseline(good: Sequence[Row], scenario: Mapping[str, Any]) -> list[str]:
    """Of a study that sweeps nothing: what each kind of reference costs, and what it takes off at each payload."""
    limits = scenario.get("limits") or {}
    turned = limits.get("jerk_rad_s3")
    jerk, unit = (limits.get("jerk_m_s3"), "m/s³") if turned is None else (turned, "rad/s³")
    by_case = {(row.payload_kg, row.reference): row for row in good if not row.assigned}
    payloads = sorted({payload for payload, reference in by_case if reference == BASELINE})
    texts = []
    for name, kind in planned_kinds().items():
        both = [payload for payload in payloads if (payload, name) in by_case]
        pairs = [(payload, by_case[payload, BASELINE], by_case[payload, name]) for payload in both]
        if name == BASELINE or kind.same_time_as or not pairs or (kind.needs_jerk and jerk is None):
            continue
        limited = f", jerk-limited at {jerk:g} {unit}," if kind.needs_jerk else ""
        texts.append(f"{kind.words[0].upper()}{kind.words[1:]}{limited} {_price(pairs)}.")
    return texts


def _price(pairs: Sequence[tuple[float, Row, Row]]) -> str:
    longer = [(row["move_time_s"] - base["move_time_s"]) / row["moves"] for _, base, row in pairs]
    judged = metrics_of([row for _, _, row in pairs])
    peak = judged.by_name[judged.peak]
    off = [
        f"{100.0 * (1.0 - row[peak.name] / base[peak.name]):.1f} % off the {judged.input_words} peak "
        f"{f'at {payload:g} kg ' if judged.payload else ''}"
        f"({peak.text(base[peak.name])} → {peak.text(row[peak.name])} {judged.input_unit})"
        for payload, base, row in pairs
    ]
    costs = f"{min(longer):.2g}" if max(longer) - min(longer) < 0.005 else f"{min(longer):.2g} to {max(longer):.2g}"
    return f"costs {costs} s per move and takes {_listed(off[:4])}"


def _heat(good: Sequence[Row]) -> list[str]:
    known = [row for row in good if row.get("thermal_load_percent") > 0.0]
    if not known:
        return []
    hot = max(known, key=lambda row: row["thermal_load_percent"])
    if not metrics_of(known).payload:
        return [_axis_heat(hot, good)]
    load, seconds = hot["thermal_load_percent"], hot["i2t_s"]
    where = run_in_words(hot, swept_axes(good))
    above = max(row["overload_time_s"] for row in known)
    text = f"The motors' thermal load is at most {load:.0f} % of nominal ({where})"
    if load > 100.0:
        pause = seconds - seconds / load * 100.0
        text += f": repeated without end the cycle needs {pause:.1f} s more of rest at no torque"
    else:
        text += ": the cycle can be repeated without end"
    return [f"{text}. One motor is above its nominal torque for up to {above:.2g} s of it."]


def _axis_heat(hot: Row, good: Sequence[Row]) -> str:
    load = hot["thermal_load_percent"]
    over = "more than it bears without end" if load > 100.0 else "the cycle can be repeated without end"
    return (
        f"The drive's thermal load is at most {load:.0f} % of nominal ({run_in_words(hot, swept_axes(good))}): {over}."
    )


def _power(good: Sequence[Row]) -> list[str]:
    known = [row for row in good if row.get("peak_power_motoring_kw") >= 0.0]
    if not known:
        return []
    up, down = (max(row[f"peak_power_{way}_kw"] for row in known) for way in ("motoring", "regenerating"))
    back = [row["energy_regenerated_j"] / row["energy_motoring_j"] for row in known if row["energy_motoring_j"] > 0.0]
    text = f"Both motors together give up to {up:.0f} kW and take back up to {down:.0f} kW"
    if back and 0.01 < max(back) < 1.0:  # runs that only lower get all of it back, and more
        low, high = f"{100.0 * min(back):.0f}", f"{100.0 * max(back):.0f}"
        text += f"; {low if low == high else f'{low} to {high}'} % of the work comes back at the shaft"
    return [f"{text}."]


def _wire(good: Sequence[Row]) -> list[str]:
    if not good or not metrics_of(good).payload:
        return []
    most = max(good, key=lambda row: row["max_wire_tension_n"])
    least = min(good, key=lambda row: row["min_wire_tension_n"])
    axes = swept_axes(good)
    text = (
        f"A fall of wire carries between {least['min_wire_tension_n'] / 1000.0:.1f} kN ({run_in_words(least, axes)}) "
        f"and {most['max_wire_tension_n'] / 1000.0:.1f} kN ({run_in_words(most, axes)})"
    )
    factors = [row["wire_safety_factor"] for row in good if row.metrics.get("wire_safety_factor") is not None]
    if factors:
        text += f"; the safety factor is {min(factors):.1f} or more"
    return [f"{text}."]


def _listed(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
