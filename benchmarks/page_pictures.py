"""Pictures of every page with content, to be looked at: `python -m benchmarks.page_pictures FOLDER [PAGE ...]`.

Each page on a light and a dark ground, 1280, 800 and 400 px wide, whole: `FOLDER/gap dark 400.png`. What is cut at a
width (values of cards, words of figures, the page itself) is printed; so is what the console says.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Literal

from tests.dashboard.test_browser import CUT
from tests.support import browser
from tests.support.browser import Visit
from tests.support.drive_files import drive_file
from workbench.dashboard.shell import FIRST, PAGES

WIDTHS = (1280, 800, 400)
SCHEMES: tuple[Literal["light", "dark"], ...] = ("light", "dark")
LONGEST_MS = 900_000.0


def press(visit: Visit, name: str, until: str = "") -> None:
    """A button, and what the page says when its work is done."""
    visit.page.get_by_role("button", name=name, exact=True).first.click()
    if until:
        visit.page.get_by_text(until).first.wait_for(timeout=LONGEST_MS)
    visit.drawn()


def compared(visit: Visit) -> None:
    visit.turn_to("Study")
    visit.drawn(figures=1)
    press(visit, "Keep for Compare", "Kept")
    visit.moved_ms(visit.page.get_by_test_id("stSlider").filter(has_text="Limit jerk"), 0.2)
    press(visit, "Keep for Compare", "Kept")
    visit.turn_to("Compare")


def diagnosed(visit: Visit) -> None:
    visit.choose("Campaign", "demo_campaign")
    if not visit.page.get_by_text("The gap comes from").count():
        press(visit, "Diagnose", "The gap comes from")


def ran(visit: Visit) -> None:
    if not visit.page.get_by_text("Torque peak per motor", exact=True).count():
        press(visit, "Start", "Torque peak per motor")


def sized(visit: Visit) -> None:
    if not visit.page.get_by_text("does not pass for").count():
        press(visit, "Size the drive")
        visit.page.get_by_text("does not pass for").first.wait_for(timeout=LONGEST_MS)
        visit.drawn()


def imported(visit: Visit) -> None:
    with tempfile.TemporaryDirectory() as folder:
        drive_file(Path(folder), ".mf4")
        visit.page.locator("input[type=file]").set_input_files(Path(folder) / "log.mf4")
        visit.drawn(figures=1)


def served(visit: Visit) -> None:
    press(visit, "Start the plant", "Built-in client")
    visit.page.get_by_text("up and down", exact=True).click()
    visit.page.wait_for_timeout(12_000)


FILLED: dict[str, Callable[[Visit], None]] = {
    "Compare": compared, "Gap": diagnosed, "Batches": ran, "Sizing": sized, "Import": imported,
    "Plant": served,
}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("pages", nargs="*", default=list(PAGES), metavar="PAGE")
    asked = parser.parse_args()
    work = ""  # what names the work of the sessions before in the address: a diagnosis is made once
    with browser.browser() as started, browser.dashboard(asked.folder / "server") as address:
        for scheme, title in product(SCHEMES, asked.pages):
            with browser.visit(started, address, asked.folder, scheme) as visit:
                visit.page.goto(f"{address}/{'' if title == FIRST else title.lower()}{work}", wait_until="commit")
                visit.drawn()
                FILLED.get(title, lambda visit: None)(visit)
                for width in WIDTHS:
                    visit.page.set_viewport_size({"width": width, "height": 800})
                    visit.page.wait_for_timeout(1000)
                    if title != "Plant":  # which is drawn anew all the time
                        visit.drawn()
                    tall = visit.page.evaluate("document.querySelector('[data-testid=stMain]').scrollHeight")
                    visit.page.set_viewport_size({"width": width, "height": max(tall + 60, 800)})
                    visit.page.wait_for_timeout(500)
                    visit.shot(f"{title.lower()} {scheme} {width}")
                    print(title, scheme, width, "cut:", visit.page.evaluate(CUT), flush=True)
                work = f"?{visit.page.url.partition('?')[2]}" if "work=" in visit.page.url else work
                print(title, scheme, "console:", visit.complaints, "asked elsewhere:", visit.asked, flush=True)


if __name__ == "__main__":
    main()
