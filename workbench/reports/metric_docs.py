"""The page of all metrics in the docs, made from their declarations.

`python -m workbench.reports.metric_docs > docs/metrics.md` writes it.
"""

from __future__ import annotations

from collections.abc import Sequence

from workbench.metrics import LoopMetric, Metric, metrics, run_metrics

_HEAD = """\
# Metrics

What each run is judged by. Every metric is taken at every sample of the controller, inside the compiled loop: a batch
that keeps no signals has the same figures. Each sample counts until the next one. The unit stands in the name; torque,
speed and power are the motors', hoisting positive. The harder-worked motor is the one with the larger share of the
torque, or with all of it once the other one failed.

In `index.parquet` each is a column. A failed run has no figures but those that are known before it runs. Better: which
way a metric improves. Least: the smallest difference that means anything, in the metric's unit.
"""
_FOOT = """
A metric is declared once, in `workbench/metrics/hoist.py`: tables, reports, comparisons, figures and the dashboard read
the declaration. This page is made from there by
`python -m workbench.reports.metric_docs`.
"""


def metrics_page() -> str:
    """docs/metrics.md, whole."""
    known = metrics()
    loop = [metric for metric in known if isinstance(metric, LoopMetric)]
    lines = [_HEAD, *_table("From the loop", loop)]
    lines += ["", *_table("From the run's reference and its machine", run_metrics())]
    return "\n".join(lines) + "\n" + _FOOT


def _table(title: str, declared: Sequence[Metric]) -> list[str]:
    rows = [
        f"| `{m.name}` | {m.unit} | {_BETTER[m.better]} | {m.visible:g} | {_cell(m.definition)} |" for m in declared
    ]
    return [f"## {title}", "", "| metric | unit | better | least | what it is |", "|---|---|---|---|---|", *rows]


_BETTER = {"lower": "lower", "higher": "higher", "zero": "nearer to 0", None: "–"}


def _cell(text: str) -> str:
    return text.replace("|", r"\|")


if __name__ == "__main__":
    print(metrics_page(), end="")
