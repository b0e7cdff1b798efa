"""The steps of a diagnosis as tables."""

from __future__ import annotations

from workbench.core.table import Column, Table, words
from workbench.diagnose.records import Diagnosis
from workbench.machines import kind_of
from workbench.reports.diagnosis.words import unit_of
from workbench.view.numbers import NOTHING, figures
from workbench.view.words import words_of

MOST_WINDOWS = 6  # of a run, that are listed


def condition_table(d: Diagnosis) -> Table:
    """The condition of the logs, one row for each run."""
    w = words_of(d.campaign.machine)
    has_payload = kind_of(d.campaign.machine).payload
    columns = [
        words("run"), *([Column("payload", "kg")] if has_payload else []), Column("length", "s"), Column("samples"),
        Column("step", "ms"), Column("noise", unit_of(d)), Column("moving", "%"), Column("clipped", "%"),
        Column("outliers"), Column("delay", "ms"),
    ]  # fmt: skip
    runs = {run.name: run for run in d.campaign.runs}
    rows = []
    for log in d.condition.runs:
        run = runs[log.name]
        load = [f"{run.payload_kg:g}"] if has_payload else []
        delay = NOTHING if log.delay_s is None else f"{1e3 * log.delay_s:.0f}"
        rows.append(
            [log.name, *load, f"{run.duration_s:.1f}", str(log.samples), figures(1e3 * log.sample_time_s),
             figures(log.noise_rms), f"{100.0 * log.moving_share:.0f}", figures(100.0 * log.clipped_share, 2),
             str(log.outliers), delay]
        )  # fmt: skip
    note = (
        f"Noise: rms of the logged {w.quantity} below {d.condition.band_hz:.3g} Hz, where measured and predicted are "
        "compared. Moving: the share of samples that speak of friction and inertia; at rest a machine may hold its "
        "load anywhere within its friction. Delay: logged speed behind its reference."
    )
    return Table(columns, rows, note)


def gap_table(d: Diagnosis) -> Table:
    """The residual of the nominal machine, and after the refit within tolerances."""
    g = d.gap
    columns = [
        words("machine"), Column(f"{words_of(d.campaign.machine).quantity}\nresidual", unit_of(d)),
        Column("times\nthe noise"), *([Column("on the\ncarriage", "N")] if g.force_rms_n is not None else []),
        Column("speed error\nopen loop", "%"),
    ]  # fmt: skip
    rows = []
    for name, residual, speed in (
        ("as given", g.nominal_residual_rms, g.nominal_speed_rmse_percent),
        ("refitted within tolerances", g.residual_rms, g.speed_rmse_percent),
        *(
            [("delivered", d.delivered.residual_rms, d.delivered.speed_rmse_percent)]
            if d.corrected != d.refitted
            else []
        ),
    ):
        row = [name, figures(residual), _times(residual, g.noise_rms)]
        if g.force_rms_n is not None:
            # One lever for both: what a torque is on the carriage.
            row.append(figures(g.force_rms_n * residual / g.residual_rms) if g.residual_rms > 0.0 else NOTHING)
        rows.append([*row, figures(speed)])
    note = (
        f"Rms while moving, as `replay` prints it in a band of {g.band_hz:.5g} Hz. Open loop: the measured input "
        "drives the model from the first sample on, so every bias adds up; judge by the residual."
    )
    return Table(columns, rows, note)


def runs_table(d: Diagnosis) -> Table:
    """Each run: its share of the gap's energy, its residual before and after, the noise."""
    unit = unit_of(d)
    columns = [words("run"), Column("of the gap's\nenergy", "%"), Column("before", unit), Column("after", unit),
               Column("noise", unit)]  # fmt: skip
    rows = [
        [run.name, f"{100.0 * run.share:.0f}", figures(run.before), figures(run.after), figures(run.noise)]
        for run in d.delivered.runs
    ]
    note = (
        "Before: refitted within tolerances; after: the delivered machine.yaml. Rms while moving, fitted to all runs."
    )
    return Table(columns, rows, note)


def _times(value: float, noise: float) -> str:
    return figures(value / noise, 2) if noise > 0.0 else NOTHING


def where_table(d: Diagnosis) -> Table:
    """Each run's share of the energy of the gap, and the window with most of it; no rows without a gap."""
    columns = [words("run"), Column("of the gap's\nenergy", "%"), Column("windows", "s", "left")]
    whose = "what the named effect does" if d.verdict.word == "named" else "the gap"
    note = f"The gap's energy run by run, and the windows that hold most of {whose}."
    if d.where is None:
        return Table(columns, [], note)
    rows = []
    for name, share in d.where.energy_by_run.items():
        mine = [w for w in d.where.windows if w.run == name]
        longest = sorted(mine, key=lambda w: w.from_s - w.to_s)[:MOST_WINDOWS]
        spans = [f"{w.from_s:.1f} to {w.to_s:.1f}" for w in mine if w in longest]
        rest = len(mine) - len(spans)
        more = f"; {rest} shorter one{'s' if rest > 1 else ''}" if rest else ""
        rows.append([name, f"{100.0 * share:.0f}", (", ".join(spans) or NOTHING) + more])
    return Table(columns, rows, note)


def visible_table(d: Diagnosis) -> Table:
    """The smallest amount of each effect that these runs can show."""
    return Table(
        [words("effect"), words("parameter"), Column("smallest\nvisible")],
        [[name, parameter, figures(size)] for name, (parameter, size) in d.isolability.visible.items()],
        "The smallest amount of each effect that these runs would show. A name's end is its unit.",
    )


def shrink_table(d: Diagnosis) -> Table:
    """The residual of the held-out runs before and after; without a gap only after."""
    s, unit = d.shrink, unit_of(d)
    rows = [_shrunk(name, *both, s.noise) for name, both in s.by_run.items()]
    if len(rows) > 1:
        rows.append(_shrunk("all runs", s.before, s.after, s.noise))
    note = f"Residual rms below {s.band_hz:.3g} Hz."
    if d.verdict.word == "no_gap":
        columns = [words("held out"), Column("residual", unit), Column("times\nthe noise")]
        return Table(columns, [[name, after, times] for name, _, after, _, times in rows], note)
    columns = [words("held out"), Column("before", unit), Column("after", unit), Column("factor"),
               Column("after, times\nthe noise")]  # fmt: skip
    return Table(columns, rows, note)


def _shrunk(name: str, before: float, after: float, noise: float) -> list[str]:
    return [name, figures(before), figures(after), figures(before / after) if after > 0.0 else NOTHING,
            _times(after, noise)]  # fmt: skip


def brief_shrink_table(d: Diagnosis) -> Table:
    """The residual and the replayed speed, before and after."""
    s, w = d.shrink, words_of(d.campaign.machine)
    low, high = s.ci95
    speed = s.speed_rmse_percent_before, s.speed_rmse_percent_after
    columns = [words("what"), Column("before"), Column("after"), Column("noise\nfloor"), Column("factor"),
               Column("95 %\ninterval")]  # fmt: skip
    rows = [
        [f"{w.quantity} residual, rms, {w.unit}", figures(s.before), figures(s.after), figures(s.noise),
         figures(s.factor), f"{figures(low)} to {figures(high)}"],
        ["speed error, open loop, %", *(figures(percent) for percent in speed), "", "", ""],
    ]  # fmt: skip
    return Table(columns, rows)


def next_run_table(d: Diagnosis) -> Table:
    """The run that would decide between open hypotheses; no row if none is open."""
    n = d.next_run
    columns = [words("profile"), Column("payload", "kg"), words("signals to log too"), Column("apart\nnow"),
               Column("apart\nwith it")]  # fmt: skip
    note = "Apart: how many standard deviations lie between the predictions of the candidates that are still open."
    if n is None:
        return Table(columns, [], note)
    load = f"{n.payload_kg:g}" if kind_of(d.campaign.machine).payload else NOTHING
    row = [n.profile, load, ", ".join(n.signals) or NOTHING, figures(n.now, 2), figures(n.separation, 2)]
    return Table(columns, [row], note)
