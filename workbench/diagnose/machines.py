"""The machine of a fit, as a record for machine.yaml, replay and study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar, cast

from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.free_parameters import LOG_TIMING, Scalar, Setting, nuisance_parameters
from workbench.diagnose.hypotheses.problem import Problem
from workbench.effects import Ranged, find, of, ranges_of
from workbench.machines import Axis, Hoist, kind_of, plant_of, value_names, with_values

DIGITS = 8  # of a fitted number: far below its standard error
AnyMachine = TypeVar("AnyMachine", bound=Hoist | Axis)


def corrected_machine(problem: Problem, base_keys: Mapping[str, Scalar], fitted: Fitted) -> Hoist | Axis:
    """The nominal machine with the fit's base values and, under `effects`, those of its hypothesis.

    base_keys: key of machine.yaml -> its parameter, as `base_parameters` gives them.
    InputError where a value does not fit the machine.
    """
    return machine_of(problem, base_keys, fitted.effects, fitted.setting)


def machine_of(
    problem: Problem, base_keys: Mapping[str, Scalar], names: Sequence[str], setting: Setting
) -> Hoist | Axis:
    """The nominal machine with everything that a setting predicts with: base values, the effects `names`, the
    allowances of the kind, the lateness of the log, and what is each run's own."""
    machine = refitted_machine(problem, base_keys, setting)
    own: dict[str, dict[str, dict[str, float]]] = {}
    for name in names:
        for r in _ranges(problem, name):
            values = setting.get(r.symbol)
            if isinstance(values, tuple):
                for run, value in zip(problem.runs, values, strict=True):
                    own.setdefault(run.name, {}).setdefault(name, {})[r.name] = _rounded(value)
    chosen = {name: _values(problem, name, setting) for name in names}
    log = machine.log.model_copy(update={"of_runs": {**machine.log.of_runs, **own}})
    return changed(
        machine,
        effects={**machine.effects, **chosen},
        allowances={name: kept for name, kept in machine.allowances.items() if name not in names},
        log=log.model_dump(),
    )


def refitted_machine(problem: Problem, base_keys: Mapping[str, Scalar], fit: Fitted | Setting) -> Hoist | Axis:
    """The nominal machine with the base values of a fit, or of its setting, the allowances and the lateness of the log,
    and no effect beyond the nominal ones and the machine's own."""
    setting = fit.setting if isinstance(fit, Fitted) else fit
    known = set(value_names(problem.machine))  # a load cell's gain is no value of the machine
    machine = with_values(
        problem.machine,
        {
            key: _rounded(_first(setting[parameter.symbol]))
            for key, parameter in base_keys.items()
            if key in known and parameter.symbol in setting
        },
    )
    allowances = dict(machine.allowances)
    # A nuisance that keeps a state is never quite off in a fit; at its least it is none.
    fitted = nuisance_parameters(problem.machine, problem.runs).values()
    least = {one.symbol: one.least for one in fitted if isinstance(one, Scalar) and not one.logarithmic}
    for trace in kind_of(machine).nuisances:
        amounts = [r for r in _ranges(problem, trace.effect) if r.vanishes_at is not None]
        none = [{r.vanishes_at, least.get(r.symbol, r.vanishes_at)} for r in amounts]
        found = [setting.get(r.symbol, r.vanishes_at) not in of for r, of in zip(amounts, none, strict=True)]
        if trace.effect not in machine.effects and any(found):
            allowances[trace.effect] = _values(problem, trace.effect, setting)
    late = machine.log.speed_late_s + _rounded(_first(setting.get(LOG_TIMING, 0.0)))
    log = machine.log.model_copy(update={"speed_late_s": max(late, 0.0)})
    own = {name: _values(problem, name, setting) for name in problem.own}
    return changed(machine, effects={**machine.effects, **own}, allowances=allowances, log=log.model_dump())


def _values(problem: Problem, name: str, setting: Setting) -> dict[str, float]:
    """An effect's parameters by name; parameters that were not fitted keep their declared values."""
    return {r.name: _rounded(_first(setting[r.symbol])) for r in _ranges(problem, name) if r.symbol in setting}


def _ranges(problem: Problem, name: str) -> tuple[Ranged, ...]:
    return ranges_of(find(name, plant_of(problem.machine).kind), problem.machine, problem.runs)


def with_effects(machine: AnyMachine, effects: Mapping[str, Mapping[str, float]]) -> AnyMachine:
    """The machine with these effects in place of its own. InputError for a value that an effect cannot have."""
    return changed(machine, effects=effects)


def changed(machine: AnyMachine, **fields: Any) -> AnyMachine:
    """The machine with other blocks. InputError for a value that an effect cannot have."""
    other = type(machine).model_validate(machine.model_dump() | fields)
    of(other)
    return cast(AnyMachine, other)


def _first(value: float | tuple[float, ...]) -> float:
    return value[0] if isinstance(value, tuple) else value


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
