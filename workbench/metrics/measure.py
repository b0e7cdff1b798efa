"""Metrics of a run whose signals are at hand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from workbench.metrics.metric import Observer
from workbench.metrics.registry import observer as hoist_observer
from workbench.run import Run


def measure(run: Run, p: Any, observer: Observer | None = None) -> dict[str, float]:
    """The compiled loop's metrics from a run's signals: a log, or a trace made by hand.

    p: the observer's parameters by symbol. observer: the hoist's without one. Each sample counts until the next one.
    """
    observer = observer or hoist_observer()
    sums: Sequence[float] = observer.start
    steps = [*(run.time_s[1:] - run.time_s[:-1]), run.sample_time_s]
    for k, dt in enumerate(steps):
        signals = {name: values[k] for name, values in run.signals.items()} | {"time_s": run.time_s[k]}
        sums = observer.update(sums, signals, p, dt)
    return observer.finish(sums, p, float(sum(steps)))
