"""What a study says in sentences, the answer to its question first: in the terminal and on its page alike."""

from __future__ import annotations

from collections.abc import Sequence

from workbench.study.conclude.bound import from_the_bound
from workbench.study.conclude.damping import on_another_damping
from workbench.study.conclude.decide import verdict
from workbench.study.conclude.sentences import sentences
from workbench.study.conclude.utilisation import alarm, utilisation
from workbench.study.execute.run import peak_limit
from workbench.study.results.row import Row
from workbench.study.scenario.load import Study


def answer(study: Study, rows: Sequence[Row], *, simulate: bool = True) -> list[str]:
    """Which reference to take, what is at its bound, how far that hangs on the damping assumed, how far the references
    are from the best, then what the rows say. simulate: the damping's sentence may take two more runs."""
    first = verdict(rows), alarm(utilisation(rows, study.machine)), on_another_damping(study) if simulate else None
    said = [*(s for s in first if s), *from_the_bound(study)]
    return [*said, *sentences(rows, peak_limit(study.machine))]
