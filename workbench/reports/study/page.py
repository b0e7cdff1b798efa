"""The report of a finished study: one page with what was run, what came out, and what that means."""

from __future__ import annotations

from pathlib import Path

from workbench.errors import InputError
from workbench.figures.save import Section, save_page
from workbench.reports.study.figures import figures_of
from workbench.reports.study.tables import decision, run_tables, what_was_run
from workbench.reports.study.words import conclusions
from workbench.study.store import Finished

MARK = "workbench report"


def write_study_report(result: Finished, path: Path) -> None:
    """Write the page; it needs no network. The same result, the same bytes.

    InputError where another file stands there, or it cannot be written.
    """
    _check_free(path)
    description = str(result.scenario.get("description") or "")
    section = Section(
        sentences=[description] if description else [],
        points=conclusions(result),
        tables=[*decision(result), *run_tables(result.rows), what_was_run(result)],
        figures=figures_of(result),
    )
    temporary = path.with_name(f".{path.name}.part")
    try:
        save_page([section], temporary, f"Study {result.name}", generator=MARK)
        temporary.replace(path)
    except OSError as error:
        raise InputError(f"the report cannot be written: {error.strerror or error}", file=path) from error
    finally:
        temporary.unlink(missing_ok=True)


def _check_free(path: Path) -> None:
    """An earlier report is replaced; nothing else is."""
    if path.is_dir():
        raise InputError("is a folder, expected the name of an .html file", file=path)
    if path.exists():
        with path.open(encoding="utf-8", errors="replace") as page:
            if f'content="{MARK}"' not in page.read(2000):
                raise InputError("is there and is no report; nothing is overwritten, choose another file", file=path)
