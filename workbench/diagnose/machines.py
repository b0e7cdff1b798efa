"""The machine of a fit, as a record for machine.yaml, replay and study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeVar, cast

from workbench.diagnose.hypotheses.fits import Fitted
from workbench.diagnose.hypotheses.knobs import Setting, Value
from workbench.diagnose.hypotheses.problem import Problem
from workbench.effects import Ranged, find, of, ranges_of
from workbench.machine import Axis, Hoist, value_names, with_values
from workbench.plants import plant_of

DIGITS = 8  # of a fitted number: far below its standard error
AnyMachine = TypeVar("AnyMachine", bound=Hoist | Axis)


def corrected_machine(problem: Problem, base_keys: Mapping[str, Value], fitted: Fitted) -> Hoist | Axis:
    """The nominal machine with the fit's base values and, under `effects`, those of its hypothesis.

    base_keys: key of machine.yaml -> its knob, as `base_knobs` gives them. A file holds one number
    for a parameter: what is each run's own is there as the first run has it, see `of_first_run`.
    InputError where a value does not fit the machine.
    """
    return machine_of(problem, base_keys, fitted.effects, fitted.setting)


def machine_of(
    problem: Problem, base_keys: Mapping[str, Value], names: Sequence[str], setting: Setting
) -> Hoist | Axis:
    """The nominal machine with the base values of a setting and the effects `names` as the setting has them."""
    machine = refitted_machine(problem, base_keys, setting)
    if not names:
        return machine
    chosen = {name: _values(problem, name, setting) for name in names}
    return with_effects(machine, {**machine.effects, **chosen})


def refitted_machine(problem: Problem, base_keys: Mapping[str, Value], fitted: Fitted | Setting) -> Hoist | Axis:
    """The nominal machine with the base values of a fit, or of its setting, and nothing else."""
    setting = fitted.setting if isinstance(fitted, Fitted) else fitted
    known = set(value_names(problem.machine))  # a load cell's gain is no value of the machine
    return with_values(
        problem.machine,
        {
            key: _rounded(_first(setting[knob.symbol]))
            for key, knob in base_keys.items()
            if key in known and knob.symbol in setting
        },
    )


def of_first_run(problem: Problem, fitted: Fitted) -> tuple[str, ...]:
    """Sentences on the values of the corrected machine that belong to the first run only."""
    first = problem.runs[0].name
    sentences = []
    for name in fitted.effects:
        own = [r for r in _ranges(problem, name) if isinstance(fitted.setting.get(r.symbol), tuple)]
        sentences += [f"{name}: {r.name} is each run's own; machine.yaml holds that of run {first}." for r in own]
    return tuple(sentences)


def _values(problem: Problem, name: str, setting: Setting) -> dict[str, float]:
    """An effect's parameters by name; parameters that were not fitted keep their declared values."""
    return {r.name: _rounded(_first(setting[r.symbol])) for r in _ranges(problem, name) if r.symbol in setting}


def _ranges(problem: Problem, name: str) -> tuple[Ranged, ...]:
    return ranges_of(find(name, plant_of(problem.machine).kind), problem.machine, problem.runs)


def with_effects(machine: AnyMachine, effects: Mapping[str, Mapping[str, float]]) -> AnyMachine:
    """The machine with these effects in place of its own. InputError for a value that an effect cannot have."""
    changed = type(machine).model_validate(machine.model_dump() | {"effects": effects})
    of(changed)
    return cast(AnyMachine, changed)


def _first(value: float | tuple[float, ...]) -> float:
    return value[0] if isinstance(value, tuple) else value


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
