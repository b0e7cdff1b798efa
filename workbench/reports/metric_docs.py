"""The page of all metrics in the docs, made from their declarations.

`python -m workbench.reports.metric_docs > docs/metrics.md` writes it.
"""

from __future__ import annotations

from collections.abc import Sequence

from workbench.metrics import METRICS

# What a study knows of a run beside what its loop has measured.
OF_THE_RUN = (
    (
        "position_error_end_m",
        "m",
        "height of the carriage at the end of the run minus the end of its reference, the stretch of the wire included",
    ),
    ("move_time_s", "s", "time in motion of the reference, all moves together, dwells left out"),
    ("moves", "–", "how many moves the reference makes"),
    ("hold_torque_nm", "N m", "torque of all motors that holds the load at the start"),
    ("acceleration_limit_m_s2", "m/s²", "the acceleration that the reference was planned with"),
)
_HEAD = """\
# Metrics

What each run is judged by. Every metric is taken at every sample of the controller, inside the compiled loop: a batch
that keeps no signals has the same figures. Each sample counts until the next one. The unit stands in the name; torque,
speed and power are the motors', hoisting positive. The harder-worked motor is the one with the larger share of the
torque, or with all of it once the other one failed.

In `index.parquet` each is a column. A failed run has no figures but those that are known before it runs.
"""
_FOOT = """
The metrics are declared in `workbench/metrics/hoist.py`; this page is made from there by
`python -m workbench.reports.metric_docs`.
"""


def metrics_page() -> str:
    """docs/metrics.md, whole."""
    lines = [_HEAD, *_table("From the loop", [(m.name, m.unit, m.definition) for m in METRICS])]
    lines += ["", *_table("From the run's reference and its machine", OF_THE_RUN)]
    return "\n".join(lines) + "\n" + _FOOT


def _table(title: str, entries: Sequence[tuple[str, str, str]]) -> list[str]:
    rows = [f"| `{name}` | {unit} | {_cell(definition)} |" for name, unit, definition in entries]
    return [f"## {title}", "", "| metric | unit | what it is |", "|---|---|---|", *rows]


def _cell(text: str) -> str:
    return text.replace("|", r"\|")


if __name__ == "__main__":
    print(metrics_page(), end="")
