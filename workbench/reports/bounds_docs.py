"""docs/bounds.md: the smallest and largest value of every number in machine.yaml and scenarios, with the reason.

`python -m workbench.reports.bounds_docs` prints the page.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import get_args

from pydantic import BaseModel

from workbench.machine.files import RECORDS
from workbench.study.scenario.record import Scenario
from workbench.yaml_strict.checked import bounds_of

HEAD = """# What values may be

Every number of machine.yaml and of a scenario has bounds. They are wider than any machine that is built, and narrow
enough that a slip of units is refused with file and line. Made by `python -m workbench.reports.bounds_docs`.
"""


def page() -> str:
    """The whole page."""
    parts = [HEAD]
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
        for part in (field.annotation, *get_args(field.annotation)):
            if isinstance(part, type) and issubclass(part, BaseModel):
                yield from bounded(part, f"{prefix}{name}.")


if __name__ == "__main__":
    print(page(), end="")
