"""A diagnosis as tables; a head that begins with a blank stands over words."""

from __future__ import annotations

import math
from collections.abc import Sequence

from workbench.diagnose.records import Candidate, Diagnosis, Estimate, Hypothesis
from workbench.machine import Hoist
from workbench.reports.diagnose_words import hypothesis_name
from workbench.reports.numbers import NOTHING, figures, with_error
from workbench.reports.words import words_of

WORTH_A_BAR = 1e-3  # of probability
NBSP = "\u00a0"  # so that no unit is broken
Row = list[str]
Head = tuple[str, ...]

PARAMETERS_HEAD = (" effect", " parameter", "value", "± std\nerror")
BRIEF_SHRINK_HEAD = (" ", "before", "after", "noise\nfloor", "factor", "95 %\ninterval")
WHERE_HEAD = (" run", "of the gap's\nenergy, %", " windows, s")
VISIBLE_HEAD = (" effect", " parameter", "smallest\nvisible")


def _unit(d: Diagnosis) -> str:
    return words_of(d.campaign.machine).unit.replace(" ", NBSP)


def condition_head(d: Diagnosis) -> Head:
    load = ("payload\nkg",) if isinstance(d.campaign.machine, Hoist) else ()
    return (
        " run", *load, "length\ns", "samples", "step\nms", f"noise\n{_unit(d)}", "moving\n%",
        "clipped\n%", "outliers", "delay\nms",
    )  # fmt: skip


def condition_table(d: Diagnosis) -> list[Row]:
    """The logs, run by run."""
    runs = {run.name: run for run in d.campaign.runs}
    rows = []
    for each in d.condition.runs:
        run = runs[each.name]
        load = [f"{run.payload_kg:g}"] if isinstance(d.campaign.machine, Hoist) else []
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
    return (" machine", f"{w.quantity}\nresidual\n{_unit(d)}", "times\nthe noise", *force, "speed error\nopen loop\n%")


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
        windows = [f"{w.from_s:.1f} to {w.to_s:.1f}" for w in d.where.windows if w.run == name]
        rows.append([name, f"{100.0 * share:.0f}", ", ".join(windows) or NOTHING])
    return rows


def ranking_table(rows: Sequence[Hypothesis], most: int) -> list[tuple[str, str, float]]:
    """(verdict, name, probability) of the likeliest, at least three; all others as one, under an empty verdict."""
    order = sorted(rows, key=lambda each: -each.probability)
    most = min(most, max(sum(each.probability >= WORTH_A_BAR for each in order), 3))
    shown = [
        (str(each.verdict), hypothesis_name(each.verdict, each.effects), each.probability) for each in order[:most]
    ]
    if rest := order[most:]:
        shown.append(("", f"{len(rest)} others together", sum(each.probability for each in rest)))
    return shown


def candidates_head(d: Diagnosis, *, brief: bool = False) -> Head:
    unit = _unit(d)
    head = (" hypothesis", "proba-\nbility", "explains\n%", f"residual\n{unit}", f"held out\n{unit}", "merit")
    return head if brief else (*head, " parameters ± standard error", " what speaks against it")


def candidates_table(d: Diagnosis, most: int | None = None, *, brief: bool = False) -> list[Row]:
    """The hypotheses that were fitted and those whose fit broke down, in the diagnosis' order.

    most: so many at most. brief: the fitted ones only, without parameters and objections.
    """
    probability = {
        frozenset(each.effects): each.probability for each in d.verdict.ranking if each.verdict == "named"
    }  # fmt: skip
    rows = []
    for each in [each for each in d.candidates if each.fitted or (each.failure and not brief)][:most]:
        p = probability.get(frozenset(each.effects))
        row = [
            hypothesis_name("named", each.effects),
            NOTHING if p is None else percent(p),
            NOTHING if each.explained is None else f"{100.0 * each.explained:.0f}",
            _known(each.residual_rms), _known(each.held_out_rms), _merit(each),
        ]  # fmt: skip
        rows.append(row if brief else [*row, _parameters(each), _against(each)])
    return rows


def percent(probability: float) -> str:
    """With a digit more near 0 and 1."""
    p = 100.0 * probability
    if p < 0.1:
        return "< 0.1 %" if p > 0.0 else "0 %"
    return f"{p:.1f} %" if p < 10.0 or p > 99.0 else f"{p:.0f} %"


def _known(value: float | None) -> str:
    return NOTHING if value is None else figures(value)


def _merit(each: Candidate) -> str:
    return f"{each.merit:.0f}" if each.fitted and math.isfinite(each.merit) else NOTHING


def _parameters(each: Candidate) -> str:
    return "; ".join(
        f"{one.name} {said}" for estimates in each.parameters.values() for one in estimates for said in [_said(one)]
    )


def _said(one: Estimate) -> str:
    pairs = [with_error(*pair) for pair in values_of(one)]
    if len(pairs) == 1:
        return f"{pairs[0][0]} ± {pairs[0][1]}"
    return f"of each run: {', '.join(f'{value} ± {error}' for value, error in pairs)}"


def values_of(one: Estimate) -> list[tuple[float, float]]:
    """(value, standard error), of each run where it is each run's own."""
    values = one.value if isinstance(one.value, tuple) else (one.value,)
    errors = one.std_error if isinstance(one.std_error, tuple) else (one.std_error,)
    return list(zip(values, errors, strict=True))


def _against(each: Candidate) -> str:
    if each.failure:
        return f"its fit broke down: {each.failure}"
    return "; ".join(each.against)


def chosen_candidate(d: Diagnosis) -> Candidate | None:
    """The one that the verdict names."""
    if d.verdict.word != "named":
        return None
    return next((each for each in d.candidates if set(each.effects) == set(d.verdict.effects)), None)


def parameters_table(d: Diagnosis) -> list[Row]:
    """The named effects' numbers, a line a value."""
    chosen = chosen_candidate(d)
    if chosen is None:
        return []
    rows = []
    for effect, estimates in chosen.parameters.items():
        for one in estimates:
            own = isinstance(one.value, tuple)
            for run, pair in zip(d.campaign.runs if own else [None], values_of(one), strict=True):
                rows.append([effect, one.name if run is None else f"{one.name}, run {run.name}", *with_error(*pair)])
    return rows


def visible_table(d: Diagnosis) -> list[Row]:
    """The smallest amount of each effect that these runs would show."""
    return [[name, parameter, figures(size)] for name, (parameter, size) in d.isolability.visible.items()]


def shrink_head(d: Diagnosis) -> Head:
    unit = _unit(d)
    return (" held out", f"before\n{unit}", f"after\n{unit}", "factor", "after, times\nthe noise")


def shrink_table(d: Diagnosis) -> list[Row]:
    s = d.shrink
    rows = [_shrunk(name, *both, s.noise) for name, both in s.by_run.items()]
    together = _shrunk("all runs", s.before, s.after, s.noise)
    return rows if len(rows) == 1 else [*rows, together]


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
