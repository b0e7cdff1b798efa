"""The output of `tune`: the trade-off as a table, the reasons for the choice, and the controller block."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from workbench.analysis.margins import weakest
from workbench.analysis.tune import GIVEN_AWAY, WIDER, Candidate, Tuned, Weights
from workbench.control import Cascade, Settings
from workbench.core.errors import InputError
from workbench.core.numbers import figures
from workbench.core.shown import View
from workbench.core.table import Column, Table, words
from workbench.core.whole_folder import whole_file
from workbench.core.yaml_strict import dumps
from workbench.machines import Machine, kind_of
from workbench.study.loop_design import DesignCase, Tuning
from workbench.view.loop import drawn, drive_sentences, event_words, least_sentence, load_sentence, said

COLUMNS = (
    words("what"), Column("kp"), Column("ki"), Column("weight"), Column("tracking", "%"), Column("peak", "%"),
    Column("effort", "%"), Column("Ms"), Column("band", "Hz"), Column("cost"),
)  # fmt: skip
SHOWN = 9


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
    cascade = isinstance(tuned.winner.settings, Cascade)
    return Table(COLUMNS, lines, said.candidates(tuned.winner.settings, cascade))


def sentences(case: DesignCase, tuned: Tuned, weights: Weights) -> list[str]:
    """The goal, the result, the reasons for the choice, and its cost."""
    win, kind, members = tuned.winner.score, kind_of(case.machine), tuned.members
    error, peak = (
        100.0 * (getattr(win, of) / getattr(tuned.shaped.score, of) - 1.0)
        for of in ("tracking_percent", "peak_percent")
    )
    drive = " ".join(drive_sentences(case.machine, tuned.winner.settings.sample_time_s))
    at_limit = 99.9 * kind.looped.peak_limit(case.machine) / kind.looped.input_scale(case.machine)
    least = f"{least_sentence(members)} {load_sentence(members, case.machine)}"
    return said.each(
        "tuned", tuned, kind, weights, drive, error, peak, active_limits(tuned), least, _compared(tuned),
        event_words(case), win.peak_percent >= at_limit,
    )  # fmt: skip


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
    return said.active([name for name, there in limits.items() if there])


def _compared(tuned: Tuned) -> list[str]:
    """What was also tuned: the choice, beside the loop without it."""
    rows = getattr(tuned.winner.settings, "gain_schedule", None)
    lines = [] if rows is None else [said.schedule(rows)]
    for term, best, what in (("notch", max, "largest ki"), ("shaper", min, "cost of the winner")):
        if results := {one.value: one.result for one in tuned.compared if one.term == term}:
            lines.append(said.term(term, best(results, key=lambda one: results[one]), results, what))
    return lines


def warning(machine: Machine) -> str | None:
    """A warning that gains for an ideal drive suit no machine; None if the drive has lag, filter or delay."""
    d = machine.drive
    real = d.torque_lag_s > 0.0 or d.speed_filter_s > 0.0 or d.speed_delay_s > 0.0
    return None if real else said.ideal()


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


def write_controller(tuned: Tuned, path: Path, machine: Machine) -> None:
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
    {"candidates": lambda t: table(t.outcome)}, drawn(lambda t: (t.outcome.members, t.outcome.goal.ms_limit)), columns
)
