"""The metrics of one kind of machine, and by which of them its runs are judged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from workbench.metrics.metric import LoopMetric, Metric, Observer


@dataclass(frozen=True)
class MetricSet:
    """metrics: in the order in which tables show them. parameters: the observer's, by the loop's symbols.

    Conclusions read the rest. peak: the largest input; above: the same above what holds the load; rms; error: largest
    error of tracking; rms_error; end: position error at the end; astray: from which end error on, in its unit, or as
    many times the metric `window`. input_words: torque or force; input_unit: as sentences give it; error_words; moved:
    what moves; sides: of an end error, positive first. payload: whether runs carry one. limited_by: who is limited.
    """

    metrics: tuple[Metric, ...]
    parameters: tuple[str, ...]
    peak: str
    above: str
    rms: str
    error: str
    rms_error: str
    end: str
    astray: float
    input_words: str
    input_unit: str
    rate_unit: str
    error_words: str
    moved: str
    sides: tuple[str, str]
    payload: bool
    window: str = ""

    @cached_property
    def by_name(self) -> Mapping[str, Metric]:
        return {metric.name: metric for metric in self.metrics}

    @cached_property
    def observer(self) -> Observer:
        """As the compiled loop takes them."""
        return Observer([m for m in self.metrics if isinstance(m, LoopMetric)], self.parameters)
