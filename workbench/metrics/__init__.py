"""The metrics of a run, each declared once: add one to `workbench/metrics/hoist.py` and it is shown everywhere."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache

from workbench.core.errors import InputError, check_known
from workbench.machines import HOIST
from workbench.metrics import axis, hoist
from workbench.metrics.metric import LoopMetric, Metric, MetricSet, Observer, RunFacts, RunMetric, View

_added: list[Metric] = []


def add(*metrics: Metric) -> None:
    """Makes metrics known in this process. InputError where a name is taken."""
    for metric in metrics:
        if metric.name in by_name():
            raise InputError(f"the metric name '{metric.name}' is taken; choose another", place="metrics")
        _added.append(metric)


def forget_added() -> None:
    """Takes the added metrics out again."""
    _added.clear()


def added() -> tuple[Metric, ...]:
    return tuple(_added)


def metrics() -> tuple[Metric, ...]:
    """The hoist's metrics and the added ones, in the order in which tables show them."""
    return (*hoist.METRICS, *_added)


def set_of(kind: str) -> MetricSet:
    """The metrics of a kind of machine, by its name."""
    return _hoist_set(added()) if kind == HOIST.name else axis.SETS[kind]


def sets() -> tuple[MetricSet, ...]:
    """The hoist's first."""
    return (set_of(HOIST.name), axis.LINEAR_SET, axis.ROTARY_SET)


def set_with(names: Iterable[str]) -> MetricSet:
    """The metrics that these columns are of; the hoist's where they tell nothing."""
    known = set(names)
    return next((one for one in sets() if one.peak in known), sets()[0])


def by_name() -> Mapping[str, Metric]:
    """Of all kinds; a name that two kinds share means the same of both."""
    return {metric.name: metric for one in reversed(sets()) for metric in one.metrics}


def find(name: str) -> Metric:
    """The metric of that name. InputError with the nearest one where there is none."""
    known = by_name()
    check_known("unknown metric", name, known)
    return known[name]


def shown_in(view: View, of: MetricSet | None = None) -> tuple[Metric, ...]:
    """The metrics that a place shows; of: a kind's, the hoist's without."""
    return tuple(metric for metric in (metrics() if of is None else of.metrics) if view in metric.views)


def run_metrics(of: MetricSet | None = None) -> tuple[RunMetric, ...]:
    return tuple(metric for metric in (metrics() if of is None else of.metrics) if isinstance(metric, RunMetric))


def fixed_columns() -> tuple[str, ...]:
    """The columns that the format asks for in every index of a hoist, in its order."""
    return tuple(metric.name for metric in metrics() if metric.fixed)


def columns(of: MetricSet | None = None) -> tuple[str, ...]:
    """The columns of every index of a kind: the format's, then the loop's, then the rest. Optional ones are not among
    them."""
    of = set_of(HOIST.name) if of is None else of
    fixed = [metric.name for metric in of.metrics if metric.fixed]
    loop = [metric.name for metric in of.observer.metrics if not metric.optional]
    return tuple(dict.fromkeys((*fixed, *loop, *(metric.name for metric in run_metrics(of)))))


def observer() -> Observer:
    """The loop's metrics as the compiled loop of a hoist takes them."""
    return set_of(HOIST.name).observer


@lru_cache(maxsize=8)
def _hoist_set(added: tuple[Metric, ...]) -> MetricSet:
    return replace(hoist.SET, metrics=(*hoist.METRICS, *added))
