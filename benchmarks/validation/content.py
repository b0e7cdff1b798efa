"""What a campaign is made of: its machine, what ails it, its runs and its logger, drawn from a seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks.validation.axis import AXIS
from benchmarks.validation.families import FAMILIES, Family
from benchmarks.validation.hoist import HOIST
from benchmarks.validation.kind import Cause, Kind, Logging, RunPlan
from workbench.blind.seal import CASES, MIXED
from workbench.effects import find

KINDS: Mapping[str, Kind] = {kind.name: kind for kind in (HOIST, AXIS)}


def kind_of(family: Family) -> Kind:
    return KINDS[family.kind]


@dataclass(frozen=True)
class Content:
    """All that a campaign says and hides, but for what each run draws by itself.

    drawn: the kind's own record of the nominal machine and what it does. sensors: what a machine's own logs say of its
    sensors, in place of drawn numbers.
    """

    case: str
    family: Family
    drawn: Any
    causes: tuple[Cause, ...]
    runs: tuple[RunPlan, ...]
    logging: Logging
    sensors: Mapping[str, Any] = field(default_factory=dict)

    @property
    def kind(self) -> Kind:
        return kind_of(self.family)

    @property
    def machine(self) -> Any:
        return self.drawn.machine


def draw(
    seed: int | Sequence[int], family: str | Family, case: str = "mixed", names: Sequence[str] | None = None
) -> Content:
    """A campaign's content from a seed. names: the effects, in place of drawn ones.

    Machine, runs and causes come from streams of their own, so the same seed with another case is the same machine
    with another ailment; but for an effect that asks for a machine of its own (a turning axis, a load, or none).
    """
    seeds = [seed] if isinstance(seed, int) else list(seed)
    of_machine, of_runs, of_causes = (np.random.default_rng([*seeds, k]) for k in (1, 2, 3))
    which = FAMILIES[family] if isinstance(family, str) else family
    kind = kind_of(which)
    if case == "mixed":
        case = str(of_causes.choice(CASES, p=list(MIXED.values())))
    if names is None:
        names = _names(of_causes, case, kind)
    drawn = kind.drawn(of_machine, which, names)
    runs, logging = kind.plan(of_runs, drawn, which)
    scales = kind.scales(drawn, runs, logging)
    causes = tuple(kind.causes[name](of_causes, scales) for name in names)
    return Content(case, which, drawn, causes, runs, kind.shown_by(logging, drawn, causes))


def _names(rng: np.random.Generator, case: str, kind: Kind) -> tuple[str, ...]:
    if case == "none":
        return ()
    if case == "singles":
        return (str(rng.choice(kind.usual)),)
    return (str(rng.choice(kind.unlisted)),) if case == "unknown" else kind.pair(rng, None)


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
