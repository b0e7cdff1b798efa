"""The output of `tune`: the trade-off as a table, the reasons for the choice, and the controller block."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from workbench.analysis.family import weakest
from workbench.analysis.search import rounded_down
from workbench.analysis.tune import GIVEN_AWAY, WIDER, Candidate, Tuned, Weights
from workbench.control import Cascade, Settings
from workbench.core.errors import InputError
from workbench.core.shown import View
from workbench.core.table import Column, Table, words
from workbench.core.whole_folder import whole_file
from workbench.core.yaml_strict import dumps
from workbench.machines import Axis, Hoist, kind_of
from workbench.study.loop_design import DesignCase, Tuning
from workbench.view import loop
from workbench.view.loop import drive_sentence, effect_sentences, event_words, least_sentence, load_sentence
from workbench.view.numbers import figures
from workbench.view.words import listed

COLUMNS = (
    words("what"), Column("kp"), Column("ki"), Column("weight"), Column("tracking", "%"), Column("peak", "%"),
    Column("effort", "%"), Column("Ms"), Column("band", "Hz"), Column("cost"),
)  # fmt: skip
CAPTION = (
    "kp in {units[0]}, ki in {units[1]}{more}. Candidates that no other beats in tracking error, peak and Ms at once, "
    "spread over all that were found. Worst of all runs: tracking: {tracking}; peak, effort: {effort}. band: of the "
    "{slowest}. cost: weighted, shaped = 1."
)
SHOWN = 9


def _caption(settings: Settings) -> str:
    if not isinstance(settings, Cascade):
        return CAPTION.format(
            units=("N m s/rad", "N m/rad"), more=", of all motors", tracking="rms speed error in % of nominal speed",
            effort="largest and rms torque of the harder-worked motor in % of nominal", slowest="slowest payload",
        )  # fmt: skip
    return CAPTION.format(
        units=settings.UNITS, more=f"; kv stays {settings.kv_per_s:g} 1/s", slowest="slowest place",
        tracking="rms position error in % of a second's way at top speed",
        effort="largest and rms force or torque in % of the drive's nominal one, else of its limit, else of friction "
        "and load",
    )  # fmt: skip


def rows(tuned: Tuned) -> list[Candidate]:
    """About SHOWN of the front, evenly over the tracking error's logarithm; the winner and the start are among them."""
    front = tuned.front()
    wanted = {id(tuned.winner): tuned.winner, id(tuned.shaped): tuned.shaped}
    if front:
        x = np.log([c.score.tracking_percent for c in front])
        for at in np.linspace(x[0], x[-1], SHOWN - len(wanted)):
            near = front[int(np.argmin(np.abs(x - at)))]
            wanted.setdefault(id(near), near)
    return sorted(wanted.values(), key=lambda c: c.score.tracking_percent)


def table(tuned: Tuned) -> Table:
    """One row for each candidate; see `rows`."""
    lines = []
    for c in rows(tuned):
        mark, s, score = "winner" if c is tuned.winner else "shaped" if c is tuned.shaped else "", c.settings, c.score
        shares = [figures(score.tracking_percent), f"{score.peak_percent:.1f}", f"{score.effort_percent:.1f}"]
        gains = [figures(s.kp, 4), figures(s.ki, 4), f"{s.set_point_weight:.2f}"]
        lines.append([mark, *gains, *shares, f"{c.ms:.3f}", figures(c.bandwidth_hz), f"{c.cost:.3f}"])
    return Table(COLUMNS, lines, _caption(tuned.winner.settings))


def sentences(case: DesignCase, tuned: Tuned, weights: Weights) -> list[str]:
    """The goal, the result, the reasons for the choice, and its cost."""
    win, start, goal, kind = tuned.winner, tuned.shaped, tuned.goal, kind_of(case.machine)
    asked = f"a bandwidth of {goal.bandwidth_hz or 0.0:g} Hz with Ms and Mt at most {goal.ms_limit:g}"
    if goal.bandwidth_hz is None:
        asked = f"the best rejection of load steps with Ms at most {goal.ms_limit:g}"
    n = len(tuned.members)
    points = "points of payload and height" if kind.payload else "place" if n == 1 else "places"
    drive = " ".join([drive_sentence(case.machine, win.settings.sample_time_s), *effect_sentences(case.machine)])
    error, peak = (
        f"{100.0 * (getattr(win.score, of) / getattr(start.score, of) - 1.0):+.1f} %"
        for of in ("tracking_percent", "peak_percent")
    )
    lines = [
        f"Asked for: {asked}, at {n} {points}. {drive} "
        f"The widest bandwidth that this allows is {rounded_down(tuned.attainable_hz)} Hz.",
        _objective(tuned, weights),
        active_limits(tuned),
        *_compared(tuned),
        f"Chosen of {len(tuned.tried)} candidates: against the shaped gains tracking error {error}, "
        f"{kind.drive.quantity} peak {peak}.",
        f"The winner's loops. {least_sentence(tuned.members)} {load_sentence(tuned.members, case.machine)}",
    ]
    if said := event_words(case):
        lines.append(f"The candidates were simulated with the scenario's events: {said}.")
    if win.score.peak_percent >= 99.9 * kind.looped.peak_limit(case.machine) / kind.looped.input_scale(case.machine):
        who = "motors reach their torque" if kind.payload else f"drive reaches its {kind.drive.quantity}"
        lines.append(f"The {who} limit in these moves.")
    return lines


def _objective(tuned: Tuned, weights: Weights) -> str:
    """What the search minimises, and what it keeps to."""
    win, start, goal = tuned.winner, tuned.shaped, tuned.goal
    total = weights.tracking + weights.peak + weights.effort
    said = (
        f"Minimised: ({weights.tracking:g} x rms tracking error + {weights.peak:g} x peak + {weights.effort:g} x rms "
        f"effort) / {total:g}, each the worst of all runs over that of the shaped gains: {win.cost:.3f}. "
    )
    if goal.bandwidth_hz is not None:
        room = f"The bandwidth may be up to {WIDER - 1.0:.0%} wider than asked for, ki/kp at most the shaped gains'."
        return said + room
    ki, chosen, unit = start.settings.ki, win.settings.ki, start.settings.UNITS[1]
    return said + (
        f"The shaped gains have the largest ki that Ms allows, {figures(ki, 4)} {unit}. The search may give up "
        f"{1.0 - GIVEN_AWAY:.0%} of it, down to {figures(GIVEN_AWAY * ki, 4)}, for the rest of the sum; the winner has "
        f"{figures(chosen, 4)}, so the error after a load step integrates to {ki / chosen:.2f} times the least."
    )


def active_limits(tuned: Tuned) -> str:
    """Which of the limits the winner is at, within 1 %."""
    win, goal, worst = tuned.winner, tuned.goal, weakest(tuned.members).margins
    limits = {f"Ms {worst.ms:.3f} of {goal.ms_limit:g}": worst.ms > 0.99 * goal.ms_limit}
    if goal.bandwidth_hz is None:
        floor = GIVEN_AWAY * tuned.shaped.settings.ki
        limits[f"ki at {GIVEN_AWAY:.0%} of the largest"] = win.settings.ki < 1.01 * floor
    else:
        limits[f"Mt {worst.mt:.3f} of {goal.ms_limit:g}"] = worst.mt > 0.99 * goal.ms_limit
        limits["the bandwidth asked for"] = win.bandwidth_hz < 1.01 * goal.bandwidth_hz
        limits[f"{WIDER - 1.0:.0%} above it"] = win.bandwidth_hz > 0.99 * WIDER * goal.bandwidth_hz
        own, most = (of.settings.ki / of.settings.kp for of in (win, tuned.shaped))
        limits["ki/kp of the shaped gains"] = own > 0.99 * most
    limits["set-point weight 1"] = win.settings.set_point_weight > 0.99
    active = [name for name, there in limits.items() if there]
    return f"Active limits: {listed(active)}." if active else "No limit is active: the sum itself has its least there."


def _compared(tuned: Tuned) -> list[str]:
    """What was also tuned: the choice, beside the loop without it."""
    lines = []
    if (rows := getattr(tuned.winner.settings, "gain_schedule", None)) is not None:
        gains = ", ".join(f"{g.payload_kg:g} kg: kp {figures(g.kp_nm_s_per_rad, 4)}, ki {figures(g.ki_nm_per_rad, 4)}"
                          for g in rows)  # fmt: skip
        lines.append(f"Gains by payload: {gains}.")
    for term, best, what in (("notch", max, "largest ki"), ("shaper", min, "cost of the winner")):
        results = {one.value: one.result for one in tuned.compared if one.term == term}
        if not results:
            continue
        value = best(results, key=lambda one: results[one])
        others = f"of {len(results)} tried, {what} {figures(results[value], 4)}"
        if value is None:
            lines.append(f"No {term} is better than none: {others}.")
        else:
            without = f", without {figures(results[None], 4)}" if None in results else ""
            own = ", ".join(f"{name} {x if isinstance(x, str) else f'{x:g}'}" for name, x in value.model_dump().items())
            later = "; each move takes up to a swing longer" if term == "shaper" else ""
            lines.append(f"{term.capitalize()}: {own}; {others}{without}{later}.")
    return lines


def warning(machine: Hoist | Axis) -> str | None:
    """A warning that gains for an ideal drive suit no machine; None if the drive has lag, filter or delay."""
    d = machine.drive
    if d.torque_lag_s > 0.0 or d.speed_filter_s > 0.0 or d.speed_delay_s > 0.0:
        return None
    return (
        "Warning: the machine's drive block is ideal, so these gains are not for a real machine. Give "
        "drive.torque_lag_s, drive.speed_filter_s and drive.speed_delay_s in machine.yaml or in the scenario, and "
        "tune again."
    )


def controller_text(settings: Settings, comments: Sequence[str] = ()) -> str:
    """The `controller` block as YAML that a scenario takes as it is."""
    head = "".join(f"# {line}\n" for line in comments)
    return head + dumps({"controller": settings.model_dump(mode="json", exclude_none=True)})


def check_new(path: Path) -> None:
    """InputError if the file exists already or its folder does not."""
    if os.path.lexists(path):
        raise InputError("is there already; nothing is overwritten, choose another file", file=path)
    if not path.parent.is_dir():
        raise InputError(f"cannot be written: there is no folder {path.parent}", file=path)


def write_controller(tuned: Tuned, path: Path, machine: Hoist | Axis) -> None:
    """Whole or not at all. machine: what the gains are for, so that the file says where they are for none."""
    goal = tuned.goal
    asked = "best rejection" if goal.bandwidth_hz is None else f"bandwidth {goal.bandwidth_hz:g} Hz"
    worst = weakest(tuned.members).margins
    comments = [
        f"Written by workbench tune: {asked}, Ms at most {goal.ms_limit:g}.",
        f"Weakest of its loops: Ms {worst.ms:.3f}, phase margin {worst.phase_deg:.1f} deg, bandwidth "
        f"{worst.bandwidth_hz:.3g} Hz. Put this block into a scenario.",
    ]
    if (text := warning(machine)) is not None:
        comments.append(text)
    with whole_file(path) as part:
        part.write_text(controller_text(tuned.winner.settings, comments), encoding="utf-8")


def columns(tuning: Tuning) -> Mapping[str, Sequence[Any]]:
    """One row a candidate of the front, the best tracking first."""
    front = tuning.outcome.front()
    of_settings, of_score = (*tuning.controller.GAINS, "set_point_weight"), vars(tuning.winner.score)
    return {
        **{name: [getattr(c.settings, name) for c in front] for name in of_settings},
        **{name: [getattr(c.score, name) for c in front] for name in of_score},
        **{name: [getattr(c, name) for c in front] for name in ("ms", "bandwidth_hz", "cost")},
    }


VIEW = View(
    {"candidates": lambda t: table(t.outcome)},
    {
        "bode": lambda t: loop.bode(t.outcome.members),
        "nyquist": lambda t: loop.nyquist(t.outcome.members, t.outcome.goal.ms_limit),
        "sensitivity": lambda t: loop.gang_of_four(t.outcome.members, t.outcome.goal.ms_limit),
        "steps": lambda t: loop.steps(t.outcome.members),
    },
    columns,
)
