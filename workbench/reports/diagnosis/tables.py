"""The steps of a diagnosis as tables; a head that begins with a blank stands over words."""

from __future__ import annotations

from workbench.diagnose.records import Diagnosis
from workbench.kinds import kind_of
from workbench.reports.diagnosis.words import unit_of
from workbench.reports.numbers import NOTHING, figures
from workbench.reports.words import words_of

MOST_WINDOWS = 6  # of a run, that are listed
Row = list[str]
Head = tuple[str, ...]

BRIEF_SHRINK_HEAD = (" ", "before", "after", "noise\nfloor", "factor", "95 %\ninterval")
WHERE_HEAD = (" run", "of the gap's\nenergy, %", " windows, s")
NEXT_RUN_HEAD = (" profile", "payload\nkg", " signals to log too", "apart\nnow", "apart\nwith it")
VISIBLE_HEAD = (" effect", " parameter", "smallest\nvisible")


def condition_head(d: Diagnosis) -> Head:
    load = ("payload\nkg",) if kind_of(d.campaign.machine).payload else ()
    return (
        " run", *load, "length\ns", "samples", "step\nms", f"noise\n{unit_of(d)}", "moving\n%",
        "clipped\n%", "outliers", "delay\nms",
    )  # fmt: skip


def condition_table(d: Diagnosis) -> list[Row]:
    """The logs, run by run."""
    runs = {run.name: run for run in d.campaign.runs}
    rows = []
    for each in d.condition.runs:
        run = runs[each.name]
        load = [f"{run.payload_kg:g}"] if kind_of(d.campaign.machine).payload else []
        delay = NOTHING if each.delay_s is None else f"{1e3 * each.delay_s:.0f}"
        rows.append(
            [each.name, *load, f"{run.duration_s:.1f}", str(each.samples), figures(1e3 * each.sample_time_s),
             figures(each.noise_rms), f"{100.0 * each.moving_share:.0f}", figures(100.0 * each.clipped_share, 2),
             str(each.outliers), delay]
        )  # fmt: skip
    return rows


def gap_head(d: Diagnosis) -> Head:
    w = words_of(d.campaign.machine)
    force = ("on the\ncarriage, N",) if d.gap.force_rms_n is not None else ()
    return (
        " machine",
        f"{w.quantity}\nresidual\n{unit_of(d)}",
        "times\nthe noise",
        *force,
        "speed error\nopen loop\n%",
    )


def gap_table(d: Diagnosis) -> list[Row]:
    """The residual of the nominal machine, and after the refit within tolerances."""
    g = d.gap
    rows = []
    for name, residual, speed in (
        ("as given", g.nominal_residual_rms, g.nominal_speed_rmse_percent),
        ("refitted within tolerances", g.residual_rms, g.speed_rmse_percent),
    ):
        row = [name, figures(residual), _times(residual, g.noise_rms)]
        if g.force_rms_n is not None:
            # One lever for both: what a torque is on the carriage.
            row.append(figures(g.force_rms_n * residual / g.residual_rms) if g.residual_rms > 0.0 else NOTHING)
        rows.append([*row, figures(speed)])
    return rows


def _times(value: float, noise: float) -> str:
    return figures(value / noise, 2) if noise > 0.0 else NOTHING


def where_table(d: Diagnosis) -> list[Row]:
    """Each run's share of the gap's energy, and where in it most of that lies."""
    if d.where is None:
        return []
    rows = []
    for name, share in d.where.energy_by_run.items():
        mine = [w for w in d.where.windows if w.run == name]
        longest = sorted(mine, key=lambda w: w.from_s - w.to_s)[:MOST_WINDOWS]
        said = [f"{w.from_s:.1f} to {w.to_s:.1f}" for w in mine if w in longest]
        rest = len(mine) - len(said)
        more = f"; {rest} shorter one{'s' if rest > 1 else ''}" if rest else ""
        rows.append([name, f"{100.0 * share:.0f}", (", ".join(said) or NOTHING) + more])
    return rows


def visible_table(d: Diagnosis) -> list[Row]:
    """The smallest amount of each effect that these runs would show."""
    return [[name, parameter, figures(size)] for name, (parameter, size) in d.isolability.visible.items()]


def shrink_head(d: Diagnosis) -> Head:
    unit = unit_of(d)
    if d.verdict.word == "no_gap":
        return (" held out", f"residual\n{unit}", "times\nthe noise")
    return (" held out", f"before\n{unit}", f"after\n{unit}", "factor", "after, times\nthe noise")


def shrink_table(d: Diagnosis) -> list[Row]:
    """Under its head; without a gap there is no before."""
    s = d.shrink
    rows = [_shrunk(name, *both, s.noise) for name, both in s.by_run.items()]
    if len(rows) > 1:
        rows.append(_shrunk("all runs", s.before, s.after, s.noise))
    return [[name, after, times] for name, _, after, _, times in rows] if d.verdict.word == "no_gap" else rows


def _shrunk(name: str, before: float, after: float, noise: float) -> Row:
    return [name, figures(before), figures(after), figures(before / after) if after > 0.0 else NOTHING,
            _times(after, noise)]  # fmt: skip


def brief_shrink_table(d: Diagnosis) -> list[Row]:
    """Under BRIEF_SHRINK_HEAD: the residual and the replayed speed, before and after."""
    s, w = d.shrink, words_of(d.campaign.machine)
    low, high = s.ci95
    speed = s.speed_rmse_percent_before, s.speed_rmse_percent_after
    return [
        [f"{w.quantity} residual, rms, {w.unit}", figures(s.before), figures(s.after), figures(s.noise),
         figures(s.factor), f"{figures(low)} to {figures(high)}"],
        ["speed error, open loop, %", *(figures(each) for each in speed), "", "", ""],
    ]  # fmt: skip


def next_run_table(d: Diagnosis) -> list[Row]:
    """Under NEXT_RUN_HEAD: the run that decides what is open; none where nothing is."""
    n = d.next_run
    if n is None:
        return []
    load = f"{n.payload_kg:g}" if kind_of(d.campaign.machine).payload else NOTHING
    return [[n.profile, load, ", ".join(n.signals) or NOTHING, figures(n.now, 2), figures(n.separation, 2)]]
