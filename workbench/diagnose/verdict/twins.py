"""Hypotheses that differ in name only: they predict the same input, at base parameters that are as likely."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from workbench.diagnose.hypotheses.fits import Fitted
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.records import Names

SAME = 0.5  # merit between two
IDENTICAL = 0.1  # chi^2 of the difference of two predictions, over all samples


class Worth(Protocol):
    """A hypothesis that was weighed."""

    @property
    def names(self) -> Names: ...
    @property
    def fit(self) -> Fitted: ...
    @property
    def merit(self) -> float: ...


def groups_of(problem: Problem, weighed: Sequence[Worth]) -> tuple[tuple[Names, ...], ...]:
    """Groups of two and more, each with its worthiest first; weighed: the worthiest first.

    A hypothesis and its twin are of as many effects, all but one of them the same.
    """
    groups: list[list[Worth]] = []
    for hypothesis in weighed:
        if hypothesis.merit <= 0.0:
            continue
        group = next((group for group in groups if _same(problem, group[0], hypothesis)), None)
        if group is None:
            groups.append([hypothesis])
        else:
            group.append(hypothesis)
    return tuple(tuple(one.names for one in group) for group in groups if len(group) > 1)


def _same(problem: Problem, one: Worth, other: Worth) -> bool:
    if len(one.names) != len(other.names) or len(set(one.names) - set(other.names)) != 1:
        return False
    if abs(one.merit - other.merit) >= SAME:
        return False
    apart = problem.errors.whiten(one.fit.residual - other.fit.residual)
    return float(np.sum(apart**2)) < IDENTICAL
