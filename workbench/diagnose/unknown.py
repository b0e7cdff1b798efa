"""An unknown cause, described by curves of force over the variables that explain the residual best.

It starts from the base parameters alone. Beside a library effect that is not the cause, the curves would
show the cause less that effect's image, and the corrected machine would claim an effect it does not have.
Base parameters and table are fitted together: alone, friction levels and masses bend away from their
tolerances to cover what is missing, and the curve would show the rest.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from scipy.special import ndtri

from workbench.core.names import powers
from workbench.core.numbers import figures, with_error
from workbench.core.run import Array
from workbench.diagnose.hypotheses import settings
from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.free_parameters import base_parameters
from workbench.diagnose.hypotheses.held_out import HeldOut, folds_by_run, foretold, held_out
from workbench.diagnose.hypotheses.problem import Problem, counting
from workbench.diagnose.law import Law, find_law
from workbench.diagnose.machines import corrected_machine, machine_of, refitted_machine
from workbench.diagnose.tables import Curve, Tables, variables_of, with_table
from workbench.diagnose.verdict.answer import percent_of
from workbench.machines import Axis, Hoist, kind_of


@dataclass(frozen=True)
class Unknown:
    """What is known of an unknown cause. curves: best first; the first is in the corrected machine, if no effect is.

    law: in a formula, where one holds on what was left out. law_levels: (2 points,) the same over the first curve's
    points, forward, then backward. effects: an unlisted effect of the library that leaves no more than the curve does.
    """

    curves: tuple[Curve, ...]
    sentences: tuple[str, ...]
    law: Law | None = field(default=None, kw_only=True)
    law_levels: Array | None = field(default=None, kw_only=True)
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict, kw_only=True)


# What a measured correction may be over: what it is called, and its unit.
OVER: Mapping[str, tuple[str, str]] = {
    "speed_carriage_m_s": ("speed of the carriage", "m/s"),
    "speed_motor_rad_s": ("speed of the motors", "rad/s"),
    "position_carriage_m": ("height of the carriage", "m"),
    "angle_motor_rad": ("motor's angle", "rad"),
    "angle_drum_rad": ("drum's angle", "rad"),
    "payload_kg": ("payload", "kg"),
    "torque_load_nm": ("torque that goes through the gearbox", "N m"),
    "velocity_m_s": ("speed of the axis", "m/s"),
    "speed_rad_s": ("speed of the axis", "rad/s"),
    "position_m": ("position of the axis", "m"),
    "angle_rad": ("angle of the axis", "rad"),
    "angle_in_turn_rad": ("angle within a turn", "rad"),
    "time_s": ("time since the run's start", "s"),
    "campaign_time_s": ("time since the campaign began", "s"),
}
MINUS = "\N{MINUS SIGN}"
SYMBOLS = {
    "v": "speed",
    "x": "place",
    "t": "time since the run's start",
    "T": "time since the campaign began",
    "load": "load that is carried there",
}  # of a law's formula


def over_what(over: str) -> str:
    """In words, with its article."""
    return f"the {OVER[over][0]}" if over in OVER else over


def span(low: float, high: float, unit: str) -> str:
    """Two levels of one unit, as far as the larger one's second digit: −0.8 to 2.4 kN, 3.1 to 9.8 N."""
    largest = max(abs(low), abs(high))
    scale, prefix = (1000.0, "k") if largest >= 1000.0 and unit in ("N", "N m") else (1.0, "")
    decimals = 0 if largest == 0.0 else max(1 - math.floor(math.log10(largest / scale)), 0)
    return f"{_plain(low / scale, decimals)} to {_plain(high / scale, decimals)} {prefix}{unit}"


def _plain(value: float, decimals: int) -> str:
    text = f"{value:.{decimals}f}"
    return text.lstrip("-") if float(text) == 0.0 else text.replace("-", MINUS)


REFINED = 2  # tables that are tried on points of their own choice
DRIVEN, NEAR = 2, 0.05  # tables that are driven: the best, and others that explain nearly as much
USEFUL = 0.1  # of the gap's energy on what was left out: what takes less away stays out of the machine
STRETCHED = 0.9  # of it: what base parameters leave beyond their tolerances is stated where it is less
SHOWN = 0.02  # the same, for a curve to be shown

AnyMachine = TypeVar("AnyMachine", bound=Hoist | Axis)


@dataclass(frozen=True)
class Explained(Unknown):
    """fitted: the base parameters beside the table, its residual that of the driven simulation with the table.

    before, after: rms of the input's residual, N m (N), base parameters alone and beside the table. held_out: each
    run (or block) by table and base parameters fitted without it; machines: those of each fold.
    """

    fitted: Fitted
    before: float
    after: float
    held_out: HeldOut
    machines: tuple[Hoist | Axis, ...]


def explain(problem: Problem, fitted: Fitted, rivals: Sequence[Fitted] = (), place: str = "") -> Explained:
    """The cause as an unlisted effect of the library, as a table, and as a law in a formula.

    fitted: the base parameters' fit, without an effect. rivals: fits of unlisted effects that may explain it. place:
    where it most likely lies; of tables that explain about as much the one there is taken. The
    effect stands in the corrected machine where it leaves no more on held-out runs than the table, else the table.
    Deterministic. ValueError for a fit with effects: see the module's first lines.
    """
    found, folds = _tabled(problem, fitted, place), folds_by_run(problem)
    alone = held_out(problem, fitted, folds).rms(problem.inputs)
    curve = found.curves[0]
    if law := find_law(problem, fitted, curve.acts_on):
        variable = next(table for table in variables_of(problem) if table.over == curve.over)
        columns = Tables(problem, fitted).linear(variable, curve.at).columns
        levels = np.asarray(np.linalg.lstsq(columns, law.taken, rcond=1e-6)[0], dtype=float)
        sentence = _law_sentence(problem, law, alone)
        # Whoever reads the numbers finds those of the sentence: held against the gap of all else.
        law = replace(law, before=alone, explains=_share(problem, alone, law.after))
        found = replace(found, sentences=(*found.sentences, sentence), law=law, law_levels=levels)
    if not rivals:
        return found
    unseen, rival = min(
        ((held_out(problem, fit, folds), fit) for fit in rivals), key=lambda one: one[0].rms(problem.inputs)
    )
    share = _share(problem, alone, unseen.rms(problem.inputs))
    if share < USEFUL or unseen.rms(problem.inputs) > found.held_out.rms(problem.inputs):
        return found
    keys = base_parameters(problem.machine, problem.logged)
    machines = tuple(machine_of(problem, keys, rival.effects, setting) for setting in unseen.settings)
    whole = corrected_machine(problem, keys, rival)
    effects = {name: whole.effects[name] for name in rival.effects}
    values = ", ".join(powers(f"{key} {value:.3g}") for of in effects.values() for key, value in of.items())
    sentence = (
        f"{' and '.join(effects)}, in the library and not listed, explains {percent_of(share)} of the gap's energy on "
        f"{_left_out(problem)} ({values}). machine.yaml holds it."
    )
    return replace(
        found, sentences=(sentence, *found.sentences), effects=effects, fitted=rival, after=rival.rms(problem.inputs),
        held_out=unseen, machines=machines,
    )  # fmt: skip


def _law_sentence(problem: Problem, law: Law, alone: float) -> str:
    """alone: rms on what was left out, base parameters within their tolerances, as everything else is held against."""
    values = ", ".join(
        f"{name} = {' ± '.join(map(powers, with_error(value, error)))} {unit}".rstrip()
        for name, value, error, unit in law.values
    )
    unit = kind_of(problem.machine).drive.unit
    letters = {letter for formula in law.formulas for letter in re.findall(r"[A-Za-z]+", formula)}
    meant = "".join(f"; {symbol}: {what}" for symbol, what in SYMBOLS.items() if symbol in letters)
    stretched = ""
    if law.before < STRETCHED * alone:
        stretched = f"; base parameters alone, as far off as it takes, leave {figures(law.before)} {unit}"
    return (
        f"As a law in a formula: {law.equation}, {law.unit} at the {law.acts_on}, with {values}{meant}. On "
        f"{_left_out(problem)} it takes {percent_of(_share(problem, alone, law.after))} of the gap's energy, from "
        f"{figures(alone)} to {figures(law.after)} {unit}{stretched}. machine_law.yaml is the machine "
        "with it, law.py the effect. It says what the force looks like within these runs, not where it comes from."
    )


def _tabled(problem: Problem, fitted: Fitted, place: str) -> Explained:
    """The cause as a table, at the place it most likely lies in if one there explains about as much."""
    if fitted.effects:
        raise ValueError(f"expected the base parameters' fit, got one of {', '.join(fitted.effects)}")
    tables, before = Tables(problem, fitted), fitted.rms(problem.inputs)
    alone = held_out(problem, fitted, folds_by_run(problem))
    tried = sorted((tables.linear(table) for table in variables_of(problem)), key=lambda table: table.left)
    if tried[0].fit.explains < USEFUL:
        return _in_vain(problem, fitted, alone, tried[0].curve())
    tried = [tables.refined(table) for table in tried[:REFINED]] + tried[REFINED:]
    tried.sort(key=lambda table: table.left)
    near = [table for table in tried[:DRIVEN] if tried[0].fit.explains - table.fit.explains < NEAR]
    there = [table for table in near if table.variable.acts_on == place]
    best = min((tables.driven(table) for table in there or near), key=lambda table: table.rms)
    unseen, machines = tables.held_out(best)
    # What the stiff machine promised, the driven one has to keep.
    kept = _share(problem, alone.rms(problem.inputs), unseen.rms(problem.inputs))
    first = replace(best.curve, explains=min(kept, _share(problem, before, best.rms)))
    by_chance = foretold(problem, alone, unseen) < -float(ndtri(settings.SIGNIFICANT / len(tried)))
    if first.explains < USEFUL or by_chance:
        return _in_vain(problem, fitted, alone, first, by_chance)
    others = [table.curve() for table in tried if table is not best.tried and table.fit.explains > SHOWN]
    curves = (first, *others)
    sentences = _sentences(problem, curves, kept, (before, best.rms), (alone, unseen))
    return Explained(curves, sentences, best.fitted, before, best.rms, unseen, machines)


def _share(problem: Problem, before: float, after: float) -> float:
    """The share of the gap's energy above the noise that is explained. before, after: rms."""
    gap = before**2 - problem.noise**2
    return (before**2 - after**2) / gap if gap > 0.0 else 0.0


def _in_vain(problem: Problem, fitted: Fitted, alone: HeldOut, best: Curve, by_chance: bool = False) -> Explained:
    """The result without a useful table: the base parameters' fit as it is. What a curve takes by chance explains
    nothing."""
    keys, before = base_parameters(problem.machine, problem.logged), fitted.rms(problem.inputs)
    machines = tuple(refitted_machine(problem, keys, setting) for setting in alone.settings)
    sentence = (
        f"No table over speed, place, load or time explains what is left: the best, over {over_what(best.over)}, "
        f"takes {100.0 * max(best.explains, 0.0):.0f} % of the gap's energy away on {_left_out(problem)}"
        f"{', which may be chance' if by_chance and best.explains > 0.0 else ''}. The corrected machine holds no table."
    )
    best = replace(best, explains=0.0) if by_chance else best
    return Explained((best,), (sentence,), fitted, before, before, alone, machines)


def with_unknown(machine: AnyMachine, unknown: Unknown) -> AnyMachine:
    """The machine with the best curve as its measured correction; as it is where no curve is of use."""
    curve = unknown.curves[0] if unknown.curves else None
    return machine if curve is None or curve.explains < USEFUL else with_table(machine, curve)


def explained_machine(problem: Problem, explained: Explained) -> Hoist | Axis:
    """The nominal machine with the base values that go with the table, and the table."""
    keys = base_parameters(problem.machine, problem.logged)
    if explained.effects:
        return corrected_machine(problem, keys, explained.fitted)
    return with_unknown(refitted_machine(problem, keys, explained.fitted), explained)


def _left_out(problem: Problem) -> str:
    return "runs that were left out" if counting(problem) > 1 else "parts of the run that were left out"


def _sentences(
    problem: Problem,
    curves: Sequence[Curve],
    share: float,
    fits: tuple[float, float],
    left_out: tuple[HeldOut, HeldOut],
) -> tuple[str, ...]:
    """fits: rms, left_out: each run by a fit without it; base parameters alone, and beside the table."""
    best = curves[0]
    unit = "N m" if problem.bench.plant.input.endswith("nm") else "N"
    force, kind = ("N", "force") if best.acts_on == "guide" or unit == "N" else ("N m", "torque")
    low, high = (float(f(np.concatenate([best.forward, best.backward]))) for f in (np.min, np.max))
    (before, after), (alone, unseen) = (
        [figures(rms, 2) for rms in both] for both in (fits, (held.rms(problem.inputs) for held in left_out))
    )
    sentences = [
        f"Of tables over one variable a {kind} at the {best.acts_on} over {over_what(best.over)} explains most: "
        f"{percent_of(share)} of the gap's energy on {_left_out(problem)}. It lies between "
        f"{span(low, high, force).replace(' to ', ' and ')} against the motion; a constant in it cannot be told from "
        "the friction levels.",
        f"With that {kind} as a table beside the base parameters, {after} {unit} rms are left of {before} {unit}; on "
        f"{_left_out(problem)} {unseen} of {alone} {unit}. The noise is {figures(problem.noise, 2)} {unit}.",
    ]
    if len(curves) > 1 and curves[1].explains > 0.9 * best.explains:
        sentences.append(
            f"One at the {curves[1].acts_on} over {over_what(curves[1].over)} explains nearly as much, "
            f"{percent_of(curves[1].explains)}."
        )
    return tuple(sentences)
