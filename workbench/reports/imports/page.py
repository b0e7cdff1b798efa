"""What an import proposes: the mapping as a table, and as a page with the signals drawn."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.core.table import Column, Table, words
from workbench.figures.imports import proposed as drawn
from workbench.imports.propose import Proposed
from workbench.view.page import Section, save_page


def mapping_table(proposed: Proposed) -> Table:
    rows = []
    for p in proposed.proposals:
        remark = ""
        if p.guessed_unit:
            said = f"its unit '{p.unit}' is not known" if p.unit else "its unit is not said"
            remark = f"{said}: taken as SI; name the unit in the mapping, or a scale"
        if p.others:
            remark = "; ".join(part for part in (remark, f"also fits: {', '.join(p.others)}") if part)
        rows.append([p.signal, p.column, p.unit or "–", f"{p.factor:.6g}", remark])
    columns = [words("signal"), words("column"), words("unit"), Column("factor\nto SI"), words("remark")]
    return Table(columns, rows)


def write_page(signals: Sequence[tuple[str, str, Array, Array]], proposed: Proposed, name: str, path: Path) -> None:
    """Replaces the page. InputError where it cannot be written."""
    section = Section(
        sentences=[f"Columns that are no signal: {', '.join(proposed.unused) or 'none'}."],
        tables=[mapping_table(proposed)],
        figures=[(drawn(signals), "Each signal in SI, at its own samples; up, hoisting and forward are positive.")],
    )
    hidden = path.with_name(f".{path.name}.part")
    try:
        save_page([section], hidden, f"Import of {name}")
        os.replace(hidden, path)
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror or error}", file=path) from error
