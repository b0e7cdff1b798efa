"""What a campaign is made of: its machine, what ails it, its runs and its logger, drawn from a seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from workbench.blind.sources.simulator.causes import Cause
from workbench.blind.sources.simulator.families import FAMILIES, Family
from workbench.blind.sources.simulator.kind import Kind, Logging, RunPlan
from workbench.blind.sources.simulator.kinds import kind_of

# Cases, and their shares of a mixed set.
MIXED: Mapping[str, float] = {"singles": 2.0 / 3.0, "none": 1.0 / 6.0, "pairs": 0.1, "unknown": 1.0 / 15.0}
CASES = tuple(MIXED)


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
        names = _names(of_causes, case, kind, which)
    drawn = kind.drawn(of_machine, which, names)
    runs, logging = kind.plan(of_runs, drawn, which)
    scales = kind.scales(drawn, runs, logging)
    causes = tuple(kind.causes[name](of_causes, scales) for name in names)
    return Content(case, which, drawn, causes, runs, kind.shown_by(logging, drawn, causes))


def _names(rng: np.random.Generator, case: str, kind: Kind, family: Family) -> tuple[str, ...]:
    if case == "none":
        return ()
    if case == "singles":
        return (str(rng.choice(kind.usual(family))),)
    return (str(rng.choice(kind.unlisted)),) if case == "unknown" else kind.pair(rng, family, None)
