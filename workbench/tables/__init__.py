"""Tables of ready text: columns with head, unit and alignment, rows and a note; as plain text, HTML and Markdown.

Column, words, Table
"""

from workbench.tables.table import Column, Table, words

__all__ = ["Column", "Table", "words"]
