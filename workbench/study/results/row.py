"""One run in the index of a study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from workbench.errors import InputError, nearest
from workbench.metrics import MetricSet, set_with


@dataclass(frozen=True)
class Row:
    """What a run was, how it went, its metrics by column name.

    `row["peak_torque_percent"]` is a metric's value, NaN where the run has none; InputError with the nearest
    name for a metric that the row does not have. assigned: what a sweep or a sample has set in this run, by
    the field's place in the scenario.
    """

    run_id: str
    scenario: str
    status: str
    reason: str
    payload_kg: float
    reference: str
    metrics: Mapping[str, float | None]
    assigned: Mapping[str, float | str] = field(default_factory=dict)

    def __getitem__(self, metric: str) -> float:
        try:
            value = self.metrics[metric]
        except KeyError:
            raise InputError(f"no metric '{metric}'; {nearest(metric, self.metrics)}", place=self.run_id) from None
        return float("nan") if value is None else value

    def get(self, metric: str) -> float:
        """A metric's value, NaN where the run or an older version of the program has none."""
        value = self.metrics.get(metric)
        return float("nan") if value is None else value

    @property
    def ok(self) -> bool:
        return self.status == "ok"


def metrics_of(rows: Sequence[Row]) -> MetricSet:
    """The metrics of the kind of machine that the rows are of."""
    return set_with(rows[0].metrics if rows else ())


def with_payload(row: Row) -> bool:
    """Whether the row's machine carries payloads."""
    return metrics_of([row]).payload
