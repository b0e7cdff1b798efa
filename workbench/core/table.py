"""The record of a table and its forms: for a terminal (rich), plain text, HTML and Markdown."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from rich.table import Table as RichTable

Alignment = Literal["left", "right"]
SHORT = 28  # characters of words in HTML that are not broken


@dataclass(frozen=True)
class Column:
    """head: a few words, over several lines where a line break says so; unit: in a line of its own below them.

    Numbers are aligned right, words left.
    """

    head: str
    unit: str = ""
    align: Alignment = "right"

    @property
    def line(self) -> str:
        """Head and unit in one line; a word that was parted is whole again."""
        return " ".join(f"{self.head} {self.unit}".replace("-\n", "").split())


def words(head: str) -> Column:
    """A column of words, aligned left."""
    return Column(head, align="left")


@dataclass(frozen=True, repr=False)
class Table:
    """columns, rows: one text a column in each row; note: how to read it, below the table.

    ValueError where a row has not one text a column.
    """

    columns: Sequence[Column]
    rows: Sequence[Sequence[str]]
    note: str = ""

    def __post_init__(self) -> None:
        if wrong := [row for row in self.rows if len(row) != len(self.columns)]:
            raise ValueError(f"{len(self.columns)} columns, and a row of {len(wrong[0])}: {list(wrong[0])}")

    @property
    def heads(self) -> tuple[str, ...]:
        """Each column's head and unit in one line."""
        return tuple(column.line for column in self.columns)

    @property
    def units(self) -> tuple[str, ...]:
        """The last line of each head: the unit, a blank above numbers without one; "" above words without one."""
        blank = "\N{NO-BREAK SPACE}" if any(column.unit for column in self.columns) else ""
        return tuple(column.unit or (blank if column.align == "right" else "") for column in self.columns)

    def __bool__(self) -> bool:
        """Whether there is a row."""
        return bool(self.rows)

    def __rich__(self) -> RichTable:
        """For rich's console: words left, numbers right, units in the last line of the head."""
        from rich.table import Table as RichTable

        shown = RichTable(box=None, pad_edge=False, padding=(0, 1))
        for i, (column, unit) in enumerate(zip(self.columns, self.units, strict=True)):
            head = f"{column.head}\n{unit}" if unit else column.head
            words = column.align == "left"
            least = None if words else max(map(len, (unit, *(row[i] for row in self.rows))))
            shown.add_column(head, justify=column.align, no_wrap=words, min_width=least, vertical="bottom")
        for row in self.rows:
            shown.add_row(*row)
        return shown

    def text(self, width: int = 1000) -> str:
        """Plain text without the note, at most so many characters wide: heads of numbers are wrapped, then words are
        cut with an ellipsis. No number is cut while there is room for all of them."""
        from rich.console import Console

        console = Console(file=io.StringIO(), width=width, color_system=None, legacy_windows=False)
        with console.capture() as captured:
            console.print(self)
        return "\n".join(line.rstrip() for line in captured.get().splitlines())

    def markdown(self) -> str:
        """A Markdown table, without the note."""
        rule = ["---" if column.align == "left" else "---:" for column in self.columns]
        cells = ([cell.replace("|", r"\|").replace("\n", " ") for cell in row] for row in (self.heads, *self.rows))
        lines = [f"| {' | '.join(row)} |" for row in cells]
        return "\n".join([lines[0], f"|{'|'.join(rule)}|", *lines[1:]])

    def html(self) -> str:
        """An HTML table with its note below, as text that Jinja takes as it is (`markupsafe.Markup`)."""
        from workbench.core.templates import render

        return render("core/table.html.j2", table=self, short=SHORT)

    def _repr_html_(self) -> str:
        """In a notebook."""
        return self.html()

    def __repr__(self) -> str:
        """As plain text with its note."""
        return "\n".join([self.text(), *([self.note] if self.note else [])])


def table_of(records: Iterable[Any], cells: Mapping[Column, Callable[[Any], str]], note: str = "") -> Table:
    """A row a record. cells: each column, and how a record's text in it is made."""
    return Table(list(cells), [[text(record) for text in cells.values()] for record in records], note)
