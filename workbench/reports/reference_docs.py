"""The page of all kinds of references in the docs, made from their declarations.

`python -m workbench.reports.reference_docs > docs/references.md` writes it.
"""

from __future__ import annotations

from collections.abc import Sequence

from workbench.references import ReferenceKind, planned_kinds, recorded_kinds

_HEAD = """\
# References

What the carriage is asked to do over time. Under `references:` a scenario names kinds that are planned from its moves
and limits, and runs of a campaign that are followed again. Each payload is run with each reference.
"""
_FOOT = """
A recorded reference is a block: `{kind: recorded, campaign: …, run: …}`; one that is smoothed has `smoothing_s` too.
`name:` tells two of a kind apart in the results.

A kind is declared once, in `workbench/references/library`: scenario files, their schema, studies, sentences, figures
and the dashboard read the declaration. A package of your own adds kinds through the entry point group
`workbench.references`. This page is made from there by `python -m workbench.reports.reference_docs`.
"""


def references_page() -> str:
    """docs/references.md, whole."""
    planned, recorded = list(planned_kinds().values()), list(recorded_kinds().values())
    lines = [_HEAD, *_table("Planned from moves and limits", planned), "", *_table("Recorded", recorded)]
    return "\n".join(lines) + "\n" + _FOOT


def _table(title: str, kinds: Sequence[ReferenceKind]) -> list[str]:
    rows = [f"| `{kind.name}` | {kind.label} | {kind.definition} |" for kind in kinds]
    return [f"## {title}", "", "| reference | in figures | what it is |", "|---|---|---|", *rows]


if __name__ == "__main__":
    print(references_page(), end="")
