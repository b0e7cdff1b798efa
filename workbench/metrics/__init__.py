"""The metrics of a run, each declared once: add one to `workbench/metrics/hoist.py` and it is shown everywhere."""

from workbench.metrics.metric import LoopMetric, Metric, MetricSet, RunFacts, RunMetric, View
from workbench.metrics.registry import (
    add,
    added,
    by_name,
    columns,
    find,
    fixed_columns,
    forget_added,
    metrics,
    observer,
    run_metrics,
    set_of,
    set_with,
    shown_in,
)
