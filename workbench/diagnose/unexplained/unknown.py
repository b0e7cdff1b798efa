"""An unknown cause, described by curves of force over the variables that explain the residual best.

It starts from the base parameters alone. Beside a library effect that is not the cause, the curves would
show the cause less that effect's image, and the corrected machine would claim an effect it does not have.
Base parameters and table are fitted together: alone, friction levels and masses bend away from their
tolerances to cover what is missing, and the curve would show the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.free_parameters import base_parameters
from workbench.diagnose.hypotheses.held_out import HeldOut, folds_by_run, held_out
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.machines import refitted_machine
from workbench.diagnose.unexplained.records import Curve, Unknown
from workbench.diagnose.unexplained.table_driven import Tables, with_table
from workbench.diagnose.unexplained.tables import variables_of
from workbench.diagnose.unexplained.words import OVER, over_what, span
from workbench.machines import Axis, Hoist

REFINED = 2  # tables that are tried on points of their own choice
DRIVEN, NEAR = 2, 0.05  # tables that are driven: the best, and others that explain nearly as much
USEFUL = 0.1  # of the gap's energy on what was left out: a table that takes less away stays out of the machine
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


def explain(problem: Problem, fitted: Fitted) -> Explained:
    """fitted: the base parameters' fit, without an effect. Deterministic. The first curve is the table's.

    ValueError for a fit with effects: see the module's first lines.
    """
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
    best = min((tables.driven(table) for table in near), key=lambda table: table.rms)
    unseen, machines = tables.held_out(best)
    # What the stiff machine promised, the driven one has to keep.
    kept = _share(problem, alone.rms(problem.inputs), unseen.rms(problem.inputs))
    first = replace(best.curve, explains=min(kept, _share(problem, before, best.rms)))
    if first.explains < USEFUL:
        return _in_vain(problem, fitted, alone, first)
    others = [table.curve() for table in tried if table is not best.tried and table.fit.explains > SHOWN]
    curves = (first, *others)
    sentences = _sentences(problem, curves, before, best.rms, unseen.rms(problem.inputs))
    return Explained(curves, sentences, best.fitted, before, best.rms, unseen, machines)


def _share(problem: Problem, before: float, after: float) -> float:
    """The share of the gap's energy above the noise that is explained. before, after: rms."""
    gap = before**2 - problem.noise**2
    return (before**2 - after**2) / gap if gap > 0.0 else 0.0


def _in_vain(problem: Problem, fitted: Fitted, alone: HeldOut, best: Curve) -> Explained:
    """The result without a useful table: the base parameters' fit as it is."""
    keys, before = base_parameters(problem.machine, problem.runs), fitted.rms(problem.inputs)
    machines = tuple(refitted_machine(problem, keys, setting) for setting in alone.settings)
    sentence = (
        f"No force over speed, place, load or time explains what is left: the best, over {over_what(best.over)}, "
        f"takes {100.0 * max(best.explains, 0.0):.0f} % of its energy away on {_left_out(problem)}. "
        "The corrected machine holds no table."
    )
    return Explained((best,), (sentence,), fitted, before, before, alone, machines)


def with_unknown(machine: AnyMachine, unknown: Unknown) -> AnyMachine:
    """The machine with the best curve as its measured correction; as it is where no curve is of use."""
    curve = unknown.curves[0] if unknown.curves else None
    return machine if curve is None or curve.explains < USEFUL else with_table(machine, curve)


def explained_machine(problem: Problem, explained: Explained) -> Hoist | Axis:
    """The nominal machine with the base values that go with the table, and the table."""
    keys = base_parameters(problem.machine, problem.runs)
    return with_unknown(refitted_machine(problem, keys, explained.fitted), explained)


def _left_out(problem: Problem) -> str:
    return "runs that were left out" if len(problem.runs) > 1 else "parts of the run that were left out"


def _sentences(
    problem: Problem, curves: Sequence[Curve], before: float, after: float, unseen: float
) -> tuple[str, ...]:
    best = curves[0]
    unit = "N m" if problem.bench.plant.input.endswith("nm") else "N"
    force, kind = ("N", "force") if best.acts_on == "guide" or unit == "N" else ("N m", "torque")
    low, high = (float(f(np.concatenate([best.forward, best.backward]))) for f in (np.min, np.max))
    sentences = [
        f"A {kind} at the {best.acts_on} that depends on {over_what(best.over)} explains it best: "
        f"{100.0 * best.explains:.0f} % of its energy on {_left_out(problem)}. It lies between "
        f"{span(low, high, force).replace(' to ', ' and ')} against the motion; a constant in it cannot be told from "
        "the friction levels.",
        f"With that {kind} as a table beside the base parameters, {after:.2g} {unit} rms are left of {before:.2g} "
        f"{unit}; on {_left_out(problem)} {unseen:.2g} {unit}. The noise is {problem.noise:.2g} {unit}.",
        "The table stands in for a cause that nobody knows. It holds where the runs have been, "
        f"{span(float(best.at[0]), float(best.at[-1]), OVER.get(best.over, ('', ''))[1]).strip()}, and no further.",
    ]
    if len(curves) > 1 and curves[1].explains > 0.9 * best.explains:
        sentences.append(
            f"One at the {curves[1].acts_on} that depends on {over_what(curves[1].over)} explains nearly as much, "
            f"{100.0 * curves[1].explains:.0f} %."
        )
    return tuple(sentences)
