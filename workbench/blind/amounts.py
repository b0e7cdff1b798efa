"""An effect made smaller or larger: its amounts go so far towards the value at which they vanish; shapes stay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from workbench.blind.sources.simulator.causes import Cause
from workbench.effects import find


def scaled(cause: Cause, size: float, plant: str) -> Cause:
    """The cause at `size` of its amounts, on a plant of this kind. One that the library does not list stays as it is.

    An amount is a parameter of the library's effect that has a vanishing value; the simulator's own numbers are the
    library's under other names.
    """
    if size == 1.0:
        return cause
    to: dict[float, float] = {}
    for name, numbers in cause.library.items():
        vanishing = {p.named(plant): p.vanishes_at for p in find(name, plant).parameters}
        for key, value in numbers.items():
            zero = vanishing.get(key)
            if zero is not None:
                to[value] = zero + size * (value - zero)

    def changed(numbers: Mapping[str, float]) -> dict[str, float]:
        return {key: to.get(value, value) for key, value in numbers.items()}

    return replace(
        cause,
        values=changed(cause.values),
        truth=changed(cause.truth),
        log=changed(cause.log),
        library={name: changed(numbers) for name, numbers in cause.library.items()},
    )
