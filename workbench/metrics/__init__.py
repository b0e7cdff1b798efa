"""The metrics of a run, each declared once: add one to `workbench/metrics/hoist.py` and it is shown everywhere."""

from workbench.metrics.metric import (
    EVERYWHERE,
    HUGE,
    INDEX_ONLY,
    Accumulators,
    Better,
    LoopMetric,
    Metric,
    MetricSet,
    Observer,
    RunFacts,
    RunMetric,
    View,
)
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
    sets,
    shown_in,
)
