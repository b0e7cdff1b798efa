"""All metrics there are: those of the hoist, and those that a program adds to them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

from workbench.errors import InputError, nearest
from workbench.metrics import hoist
from workbench.metrics.metric import LoopMetric, Metric, Observer, RunMetric, View

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
    """All metrics in the order in which tables show them."""
    return (*hoist.METRICS, *_added)


def by_name() -> Mapping[str, Metric]:
    return {metric.name: metric for metric in metrics()}


def find(name: str) -> Metric:
    """The metric of that name. InputError with the nearest one where there is none."""
    known = by_name()
    if name not in known:
        raise InputError(f"unknown metric '{name}'; {nearest(name, known)}")
    return known[name]


def shown_in(view: View) -> tuple[Metric, ...]:
    """The metrics that a place shows."""
    return tuple(metric for metric in metrics() if view in metric.views)


def run_metrics() -> tuple[RunMetric, ...]:
    return tuple(metric for metric in metrics() if isinstance(metric, RunMetric))


def fixed_columns() -> tuple[str, ...]:
    """The columns that the format asks for in every index, in its order."""
    return tuple(metric.name for metric in metrics() if metric.fixed)


def columns() -> tuple[str, ...]:
    """The columns of every index: the format's, then the loop's, then the rest. Optional ones are not among them."""
    loop = [metric.name for metric in observer().metrics if not metric.optional]
    return tuple(dict.fromkeys((*fixed_columns(), *loop, *(metric.name for metric in run_metrics()))))


def observer() -> Observer:
    """The loop's metrics as the compiled loop of a hoist takes them."""
    return _observer(tuple(metric for metric in metrics() if isinstance(metric, LoopMetric)))


@lru_cache(maxsize=8)
def _observer(metrics: tuple[LoopMetric, ...]) -> Observer:
    return Observer(metrics, hoist.PARAMETERS)
