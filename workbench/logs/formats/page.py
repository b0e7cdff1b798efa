"""What docs/formats.md says of the log files, made from their declarations.

`python -m workbench.logs.formats.page docs/formats.md` writes it between its two marks.
"""

from __future__ import annotations

import sys
import textwrap
from pathlib import Path

from workbench.logs.formats.declared import MB, Limits
from workbench.logs.formats.known import formats

BEGIN, END = "<!-- log formats: made by workbench.logs.formats.page -->\n", "<!-- end of log formats -->\n"


def section() -> str:
    """The formats with their endings, what is said of each, and the limits."""
    lines = []
    for log_format in formats():
        endings = ", ".join(f"`{suffix}`" for suffix in log_format.suffixes)
        text = f"- **{log_format.name}** ({endings}): {log_format.about}"
        lines.append(textwrap.fill(text, 116, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False))
    lines += ["", "What one log may take, counted in what is really produced from it:", ""]
    lines += ["| format | whose | rows | unpacked | processor time | memory of the reader | read in |"]
    lines += ["|---|---|---|---|---|---|---|"]
    for log_format in formats():
        own = "a worker" if log_format.isolated else "this process"
        lines.append(f"| {log_format.name} | your own | {_words(log_format.own)} | {own} |")
        lines.append(f"| {log_format.name} | uploaded | {_words(log_format.uploaded)} | a worker |")
    return "\n".join(lines) + "\n"


def _words(limits: Limits) -> str:
    return (
        f"{limits.rows / MB:g} million | {limits.bytes / MB:g} MB | {limits.seconds:g} s | "
        f"{limits.memory_bytes / MB:g} MB"
    )


def written(page: str) -> str:
    """The page with the section of today."""
    before, _, rest = page.partition(BEGIN)
    return f"{before}{BEGIN}{section()}{END}{rest.partition(END)[2]}"


if __name__ == "__main__":
    file = Path(sys.argv[1])
    file.write_text(written(file.read_text(encoding="utf-8")), encoding="utf-8")
