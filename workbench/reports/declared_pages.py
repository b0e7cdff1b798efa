"""The pages of the docs that are made from declarations: metrics, references, bounds of values.

`python -m workbench.reports.declared_pages metrics > docs/metrics.md` writes one of them.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, get_args

from pydantic import BaseModel

from workbench.machine.files import RECORDS
from workbench.metrics import LoopMetric, Metric, metrics, run_metrics, set_of
from workbench.references import ReferenceKind, planned_kinds, recorded_kinds
from workbench.study.scenario import Scenario
from workbench.yaml_strict.checked import bounds_of

_METRICS = """\
# Metrics

What each run is judged by. Every metric is taken at every sample of the controller, inside the compiled loop: a batch
that keeps no signals has the same figures. Each sample counts until the next one. The unit stands in the name; torque,
speed and power are the motors', hoisting positive. The harder-worked motor is the one with the larger share of the
torque, or with all of it once the other one failed.

In `index.parquet` each is a column. A failed run has no figures but those that are known before it runs. Better: which
way a metric improves. Least: the smallest difference that means anything, in the metric's unit.
"""
_METRICS_END = """
A metric is declared once, in `workbench/metrics/hoist.py`: tables, reports, comparisons, figures and the dashboard read
the declaration. This page is made from there by
`python -m workbench.reports.declared_pages metrics`.
"""


def metrics_page() -> str:
    """docs/metrics.md, whole."""
    known = metrics()
    loop = [metric for metric in known if isinstance(metric, LoopMetric)]
    lines = [_METRICS, *_metric_table("From the loop", loop)]
    lines += ["", *_metric_table("From the run's reference and its machine", run_metrics())]
    for kind, title in (("axis-linear", "Of a linear axis"), ("axis-rotary", "Of a rotary axis")):
        lines += ["", *_metric_table(title, set_of(kind).metrics)]
    return "\n".join(lines) + "\n" + _METRICS_END


def _metric_table(title: str, declared: Sequence[Metric]) -> list[str]:
    rows = [
        f"| `{m.name}` | {m.unit} | {_BETTER[m.better]} | {m.visible:g} | {_cell(m.definition)} |" for m in declared
    ]
    return [f"## {title}", "", "| metric | unit | better | least | what it is |", "|---|---|---|---|---|", *rows]


_BETTER = {"lower": "lower", "higher": "higher", "zero": "nearer to 0", None: "–"}


def _cell(text: str) -> str:
    return text.replace("|", r"\|")


_REFERENCES = """\
# References

What the carriage is asked to do over time. Under `references:` a scenario names kinds that are planned from its moves
and limits, and runs of a campaign that are followed again. Each payload is run with each reference.
"""
_REFERENCES_END = """
A recorded reference is a block: `{kind: recorded, campaign: …, run: …}`; one that is smoothed has `smoothing_s` too.
`name:` tells two of a kind apart in the results.

A kind is declared once, in `workbench/references/library`: scenario files, their schema, studies, sentences, figures
and the dashboard read the declaration. A package of your own adds kinds through the entry point group
`workbench.references`. This page is made from there by `python -m workbench.reports.declared_pages references`.
"""


def references_page() -> str:
    """docs/references.md, whole."""
    planned, recorded = list(planned_kinds().values()), list(recorded_kinds().values())
    lines = [
        _REFERENCES,
        *_reference_table("Planned from moves and limits", planned),
        "",
        *_reference_table("Recorded", recorded),
    ]
    return "\n".join(lines) + "\n" + _REFERENCES_END


def _reference_table(title: str, kinds: Sequence[ReferenceKind]) -> list[str]:
    rows = [f"| `{kind.name}` | {kind.label} | {kind.definition} |" for kind in kinds]
    return [f"## {title}", "", "| reference | in figures | what it is |", "|---|---|---|", *rows]


_BOUNDS = """# What values may be

Every number of machine.yaml and of a scenario has bounds. They are wider than any machine that is built, and narrow
enough that a slip of units is refused with file and line. Made by `python -m workbench.reports.declared_pages bounds`.
"""


def bounds_page() -> str:
    """docs/bounds.md, whole."""
    parts = [_BOUNDS]
    for record in (*RECORDS, Scenario):
        fields = record.model_fields
        title = [str(fields[name].default) for name in ("kind", "motion") if name in fields]
        rows = [f"| `{name}` | {low:g} | {high:g} | {reason} |" for name, low, high, reason in bounded(record)]
        name = f"machine.yaml, {' '.join(title)}" if title else "A scenario"
        parts.append("\n".join([f"## {name}", "", "| value | from | to | reason |", "|---|---|---|---|", *rows, ""]))
    return "\n".join(parts)


def bounded(record: type[BaseModel], prefix: str = "") -> Iterator[tuple[str, float, float, str]]:
    """(dotted name, lowest, highest, reason) of every number of a record whose bounds have a reason."""
    for name, field in record.model_fields.items():
        if (bounds := bounds_of(field)) is not None:
            yield f"{prefix}{name}", bounds.lowest, bounds.highest, bounds.because.reason
            continue
        inner = [line for part in _records_in(field.annotation) for line in bounded(part, f"{prefix}{name}.")]
        yield from {line[0]: line for line in inner}.values()


def _records_in(annotation: Any) -> list[type[BaseModel]]:
    """The records that an annotation holds, however deep."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [record for part in get_args(annotation) for record in _records_in(part)]


PAGES: Mapping[str, Callable[[], str]] = {
    "metrics": metrics_page,
    "references": references_page,
    "bounds": bounds_page,
}


if __name__ == "__main__":
    print(PAGES[sys.argv[1]](), end="")
