"""What differs from run to run of one machine, such as the phase of the heave, and what that means for a study."""

from __future__ import annotations

from workbench.effects import effects_for, sizes_of
from workbench.machine import Hoist

PHASES = 4


def per_run(machine: Hoist) -> tuple[str, ...]:
    """The machine's effects that have a number of their own in each run."""
    known = effects_for("hoist")
    return tuple(name for name in machine.effects if any(parameter.per_run for parameter in known[name].parameters))


def from_the_cold(machine: Hoist) -> tuple[str, ...]:
    """The machine's effects that go with the time since the campaign began."""
    known = effects_for("hoist")
    others = per_run(machine)
    return tuple(name for name in machine.effects if known[name].regime == "time" and name not in others)


def at_phases(machine: Hoist) -> list[Hoist]:
    """The machine itself or, where an effect has numbers of each run, with four of them evenly over their range."""
    own = per_run(machine)
    if not own:
        return [machine]
    sizes, known = sizes_of(machine), effects_for("hoist")
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
