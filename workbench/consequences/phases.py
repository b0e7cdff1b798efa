"""Values that differ from run to run of one machine, such as the phase of the heave, in a study."""

from __future__ import annotations

from workbench.effects import effects_for, sizes_of
from workbench.kinds import kind_of
from workbench.machine import Axis, Hoist

PHASES = 4


def per_run(machine: Hoist | Axis) -> tuple[str, ...]:
    """The effects of the machine with a value that differs from run to run."""
    known = effects_for(kind_of(machine).name)
    return tuple(name for name in machine.effects if any(parameter.per_run for parameter in known[name].parameters))


def from_the_cold(machine: Hoist | Axis) -> tuple[str, ...]:
    """The effects of the machine that depend on the time since the start of the campaign."""
    known = effects_for(kind_of(machine).name)
    others = per_run(machine)
    return tuple(name for name in machine.effects if known[name].regime == "time" and name not in others)


def at_phases(machine: Hoist | Axis) -> list[Hoist | Axis]:
    """The machine itself or, if an effect has a value for each run, four machines evenly over its range."""
    own = per_run(machine)
    if not own:
        return [machine]
    sizes, known = sizes_of(machine), effects_for(kind_of(machine).name)
    machines = []
    for k in range(PHASES):
        effects = {name: dict(values) for name, values in machine.effects.items()}
        for name in own:
            for parameter in known[name].ranges(sizes):
                if parameter.per_run:
                    effects[name][parameter.name] = (
                        parameter.lowest + (parameter.highest - parameter.lowest) * k / PHASES
                    )
        machines.append(machine.model_copy(update={"effects": effects}))
    return machines
