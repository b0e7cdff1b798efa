"""The output of `loop`: margins as a table, sentences, JSON, and the page of figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from workbench.analysis.family import Member, weakest
from workbench.analysis.margins import Margins
from workbench.analysis.step import load_step, position_answer
from workbench.control import Cascade
from workbench.core.json_records import rounded
from workbench.core.table import Column, Table
from workbench.core.whole_folder import write_json
from workbench.effects import find
from workbench.figures.loop import bode, gang_of_four, nyquist, steps
from workbench.machines import Axis, Hoist, kind_of
from workbench.reports.loop.case import LoopCaseFile
from workbench.view.numbers import NOTHING, figures
from workbench.view.page import Section, save_page

MARGINS = (
    Column("gain", "dB"), Column("phase", "°"), Column("delay", "ms"),
    Column("disk"), Column("Ms"), Column("Mt"), Column("cross", "Hz"), Column("band", "Hz"), Column("reject", "Hz"),
    Column("slowest", "1/s"), Column("least ζ"),
)  # fmt: skip
LOAD_NM = 100.0  # that sentences name, of a hoist: about a tenth of the default motors' nominal torque
GONE = 0.01  # of the largest way: nothing of it stays
CAPTION = (
    "Margins: how much more gain (after a slash: less), phase and delay the loop bears; disk: gain and phase at once "
    "(0 nothing, 2 the most). Ms, Mt: largest |1/(1+L)| and |L/(1+L)|. cross: where |L| is 1; band: where |T| falls "
    "below -3 dB; reject: where |S| first rises above -3 dB. slowest, ζ: real part of the slowest and damping of the "
    "least damped closed-loop pole."
)


def table(members: Sequence[Member]) -> Table:
    """One row for each loop."""
    kind = members[0].loop.kind
    place = Column("height" if kind.payload else "position", kind.moved.unit)
    where = [Column("load", "kg"), place] if kind.payload else [place]
    return Table([*where, *MARGINS], [_line(member) for member in members], CAPTION)


def _line(member: Member) -> list[str]:
    m, point = member.margins, member.point
    where = [*([f"{point.payload_kg:g}"] if member.loop.kind.payload else []), f"{point.height_m:g}"]
    slowest, damping = poles_in_s(member)
    if not m.stable:
        return [*where, "unstable", *[NOTHING] * 8, figures(slowest), figures(damping)]
    return [
        *where, gain_text(m), figures(m.phase_deg), figures(1000.0 * m.delay_s), figures(m.disk), figures(m.ms),
        figures(m.mt), figures(m.crossover_hz), figures(m.bandwidth_hz), figures(m.rejection_hz),
        figures(slowest), figures(damping),
    ]  # fmt: skip


def gain_text(m: Margins) -> str:
    """The gain margin in dB, and the one towards lower gain if there is one."""
    up = f"{20.0 * math.log10(m.gain_up):.1f}" if math.isfinite(m.gain_up) else NOTHING
    return f"{up}/{20.0 * math.log10(m.gain_down):.0f}" if m.gain_down > 0.0 else up


def poles_in_s(member: Member) -> tuple[float, float]:
    """(real part of the slowest pole, 1/s; smallest damping ratio), from the poles in z."""
    z = member.loop.poles()
    s = np.log(z[np.abs(z) > 1e-6]) / member.loop.dt
    return float(np.max(s.real)), float(np.min(-s.real / np.abs(s)))


def sentences(case: LoopCaseFile, members: Sequence[Member]) -> list[str]:
    """The table in sentences."""
    drive = drive_sentence(case.machine, case.settings.sample_time_s)
    unstable = [m for m in members if not m.margins.stable]
    known = effect_sentences(case.machine)
    if unstable:
        where = ", ".join(where_of(m) for m in unstable)
        return [f"{len(unstable)} of {len(members)} loops are unstable: {where}.", drive, *known]
    all_ = "The loop is stable." if len(members) == 1 else f"All {len(members)} loops are stable."
    lines = [f"{all_} {least_sentence(members)}", drive, *known, load_sentence(members, case.machine)]
    if said := event_words(case):
        lines.append(
            f"The scenario's events ({said}) leave these margins as they are: a failed motor lowers the limit of the "
            "torque, a brake adds friction, a stop changes the reference. `study` and `tune` simulate them."
        )
    heights = {m.point.height_m for m in members}
    spread = [max(x.margins.ms for x in same) - min(x.margins.ms for x in same) for same in _by_payload(members)]
    if (
        kind_of(case.machine).payload
        and len(heights) > 1
        and max(spread) < 0.01
        and "wire_stiffness_length" not in case.machine.effects
    ):
        lines.append(
            "Height makes next to no difference to Ms here: in the nominal plant the wire is equally stiff everywhere, "
            "and with a stiffness that follows the free length the drive's inertia still decides."
        )
    return lines


def where_of(member: Member) -> str:
    """A loop's operating point in words."""
    return member.loop.kind.looped.where(member.point.payload_kg, member.point.height_m)


def least_sentence(members: Sequence[Member]) -> str:
    """The smallest of each margin, with its loop."""
    worst = weakest(members)
    m = worst.margins
    downwards = -20.0 * math.log10(m.gain_down) if m.gain_down > 0.0 else math.inf
    words_of = {
        "ms": f"largest Ms {m.ms:.2f} at {figures(m.ms_hz)} Hz",
        "phase_deg": f"smallest phase margin {m.phase_deg:.0f}°",
        "gain_up": f"smallest gain margin {gain_text(m).partition('/')[0]} dB" if math.isfinite(m.gain_up) else "",
        "gain_down": f"smallest gain margin downwards {downwards:.1f} dB" if math.isfinite(downwards) else "",
        "delay_s": f"smallest delay margin {figures(1000.0 * m.delay_s)} ms",
        "bandwidth_hz": f"narrowest bandwidth {figures(m.bandwidth_hz)} Hz",
        "rejection_hz": f"disturbances rejected up to {figures(m.rejection_hz)} Hz",
    }
    by_member: dict[str, list[str]] = {}
    for name, words in words_of.items():
        if words:
            by_member.setdefault(where_of(worst.member[name]), []).append(words)
    if len(members) == 1:
        return f"Its margins: {', '.join(words for words in words_of.values() if words)}."
    return "Weakest of them: " + "; ".join(f"at {where}: {', '.join(w)}" for where, w in by_member.items()) + "."


def load_sentence(members: Sequence[Member], machine: Hoist | Axis) -> str:
    """The largest response to a load step."""
    steps_ = [load_step(member.loop) for member in members]
    peak, iae, last = (max(getattr(s, n) for s in steps_) for n in ("peak_rad_s", "iae_rad", "recovery_s"))
    kind = members[0].loop.kind
    if not kind.payload:
        way, rate, unit = kind.moved.unit, kind.moved.speed_unit, kind.drive.unit
        places = [answer for member in members if (answer := position_answer(member.loop)) is not None]
        step = _step_of(machine)
        moved = left = ""
        if places:
            most, stays = (step * max(getattr(a, name) for a in places) for name in ("peak", "left"))
            moved = f", its position by at most {_fine(most, way)}"
            left = ", and the position comes back" if stays < GONE * most else f"; {_fine(stays, way)} of the way stay"
        return (
            f"A load step of {step:g} {unit} moves the speed by at most {_fine(step * peak, rate)}{moved}; the speed "
            f"is down to a tenth after {figures(last)} s{left}."
        )
    return (
        f"{LOAD_NM:g} N m on the shaft move the speed by at most {figures(LOAD_NM * peak)} rad/s, its error integrates "
        f"to {figures(LOAD_NM * iae)} rad and is down to a tenth after {figures(last)} s."
    )


def _step_of(machine: Hoist | Axis) -> float:
    """A load step that suits an axis: about a tenth of what its inputs are judged against, one digit."""
    tenth = 0.1 * kind_of(machine).looped.input_scale(machine)
    decade = 10.0 ** math.floor(math.log10(tenth)) if tenth > 0.0 else 1.0
    return decade * max((digit for digit in (1.0, 2.0, 5.0) if digit * decade <= tenth), default=1.0)


def _fine(value: float, unit: str) -> str:
    """`75 mrad`: three digits with the prefix that they want."""
    scale, prefix = next(((s, p) for s, p in ((1.0, ""), (1e3, "m"), (1e6, "µ")) if s * value >= 1.0), (1e9, "n"))
    return f"{figures(scale * value)} {prefix}{unit}"


def event_words(case: LoopCaseFile) -> str:
    """What happens in the scenario's runs, and when: `brake_release_s 2.5`; "" for nothing."""
    given = case.events.model_dump(exclude_none=True)
    return ", ".join(f"{key} {value:g}" for key, value in given.items() if key.endswith("_s"))


def _by_payload(members: Sequence[Member]) -> list[list[Member]]:
    loads = dict.fromkeys(m.point.payload_kg for m in members)
    return [[m for m in members if m.point.payload_kg == load] for load in loads]


def drive_sentence(machine: Hoist | Axis, sample_time_s: float) -> str:
    """The drive: lag, filter and delay between commanded torque and measured speed."""
    d = machine.drive
    parts = [
        f"{1000.0 * value:g} ms {name}"
        for name, value in (
            ("torque lag", d.torque_lag_s), ("speed filter", d.speed_filter_s), ("speed delay", d.speed_delay_s)
        )
        if value > 0.0
    ]  # fmt: skip
    if not parts:
        return (
            f"The drive is ideal: only sampling at {1000.0 * sample_time_s:g} ms limits this loop. Give the drive's "
            "torque_lag_s, speed_filter_s and speed_delay_s to see what a real one leaves."
        )
    return f"In the loop: sampling at {1000.0 * sample_time_s:g} ms, {', '.join(parts)}."


def effect_sentences(machine: Hoist | Axis) -> list[str]:
    """The effects and the measured correction in the loop, and those that act on the log only; none without effects."""
    known = {name: find(name, kind_of(machine).name) for name in machine.effects}
    inside = [name for name, effect in known.items() if not effect.on_sensor]
    inside += ["measured_correction"] if machine.measured_correction is not None else []
    outside = [name for name, effect in known.items() if effect.on_sensor]
    in_loop = [f"In the machine: {', '.join(inside)}."] if inside else []
    return in_loop + ([f"Not in the loop, for they act on the log alone: {', '.join(outside)}."] if outside else [])


def as_json(case: LoopCaseFile, members: Sequence[Member]) -> dict[str, Any]:
    """Settings, drive, effects, and the margins and poles of every loop; null where there is none."""
    return {
        "controller": case.settings.model_dump(mode="json"),
        "drive": case.machine.drive.model_dump(mode="json"),
        "effects": {name: dict(values) for name, values in case.machine.effects.items()},
        "weakest": _weakest_json(members),
        "loops": [_loop_json(member) for member in members],
    }


def _weakest_json(members: Sequence[Member]) -> dict[str, Any]:
    """The smallest of each margin, with payload and height of its loop; empty if a loop is unstable."""
    worst = weakest(members)
    if not worst.margins.stable:
        return {}
    return {
        name: {
            "value": rounded(getattr(worst.margins, name), 8),
            **place_of(member),
        }
        for name, member in worst.member.items()
    }


def _loop_json(member: Member) -> dict[str, Any]:
    values = {
        name: value if isinstance(value, bool) else rounded(value, 8) for name, value in vars(member.margins).items()
    }
    z = sorted(member.loop.poles(), key=lambda p: (-abs(p), p.imag))
    poles = [[rounded(float(p.real), 12), rounded(float(p.imag), 12)] for p in z]
    kind = member.loop.kind
    where = {**place_of(member), "motion": kind.looped.motion_words[member.point.motion]}
    answer = load_step(member.loop) if member.margins.stable else None
    load = None if answer is None else {name: rounded(value, 8) for name, value in vars(answer).items()}
    if load is not None and not kind.payload:
        load = _axis_load(member, load)
    return {**where, **values, f"load_step_1_{kind.drive.suffix}": load, "poles_z": poles}


def place_of(member: Member) -> dict[str, float]:
    """An operating point as JSON has it."""
    kind, point = member.loop.kind, member.point
    if kind.payload:
        return {"payload_kg": point.payload_kg, "height_m": point.height_m}
    return {f"position_{kind.moved.unit}": point.height_m}


def _axis_load(member: Member, load: dict[str, Any]) -> dict[str, Any]:
    """The answer to a load step under names with the axis' units, and that of the position."""
    kind = member.loop.kind
    way, rate = kind.moved.unit, "m_s" if kind.moved.unit == "m" else "rad_s"
    answer = position_answer(member.loop)
    said = {f"peak_{rate}": load["peak_rad_s"], "peak_s": load["peak_s"], f"iae_{way}": load["iae_rad"]}
    said |= {"recovery_s": load["recovery_s"]}
    if answer is not None:
        said |= {f"position_peak_{way}": rounded(answer.peak, 8), f"position_left_{way}": rounded(answer.left, 8)}
    return said


def save_loop_page(case: LoopCaseFile, members: Sequence[Member], ms_limit: float, path: Path) -> None:
    """The page; it needs no network."""
    section = Section(
        sentences=[f"Controller {case.origin}: {gains_text(case)}.", *sentences(case, members)],
        tables=[table(members)],
        figures=[
            (
                bode(members),
                f"Drawn: the least gain and the least phase margin of all loops. {_phase(members[0])}",
            ),
            (nyquist(members, ms_limit), "A curve outside the grey disk keeps Ms below the limit."),
            (
                gang_of_four(members, ms_limit),
                "S: what is left of slow disturbances. T: what follows the reference. PS: a load to the speed. CS: "
                "noise of the speed to the drive.",
            ),
            (steps(members), "The linear loop; limits of the torque are not in it."),
        ],
    )
    save_page(
        [section],
        path,
        f"{'Speed' if kind_of(case.machine).payload else 'Position and speed'} loop — {case.machine.name}",
    )


def _phase(member: Member) -> str:
    """Where the phase begins, and why."""
    if position_answer(member.loop) is not None and member.margins.stable:
        return "The loop is opened at the drive, position and speed loop closed over it."
    return "The phase begins at −180°: two integrals, the controller's and the machine's."


def gains_text(case: LoopCaseFile) -> str:
    s = case.settings
    kv = f"kv {s.kv_per_s:g} 1/s, " if isinstance(s, Cascade) else ""
    kp, ki = s.UNITS
    return (
        f"{kv}kp {s.kp:g} {kp}, ki {s.ki:g} {ki}, set-point weight {s.set_point_weight:g}, "
        f"sampled every {1000.0 * s.sample_time_s:g} ms"
    )


def write_loop(case: LoopCaseFile, members: Sequence[Member], ms_limit: float, folder: Path) -> None:
    """Write loop.html and loop.json into an existing folder."""
    save_loop_page(case, members, ms_limit, folder / "loop.html")
    write_json(folder / "loop.json", as_json(case, members))
