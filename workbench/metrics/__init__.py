"""What a run is judged by."""

from workbench.metrics.hoist import HOIST_OBSERVER, METRICS
from workbench.metrics.measure import measure
from workbench.metrics.metric import HUGE, Metric, Observer, Sums

__all__ = ["HOIST_OBSERVER", "HUGE", "METRICS", "Metric", "Observer", "Sums", "measure"]
