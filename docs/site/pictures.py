"""The manual's pictures of pages, as Chromium draws them: docs/img/*_page.png. Takes two or three minutes.

python docs/site/pictures.py [study signals plant]
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.support import browser  # noqa: E402
from tests.support.browser import Visit  # noqa: E402

IMAGES = ROOT / "docs" / "img"
COLOURS = 128  # of a picture's palette: a third of the bytes
PLANT_RUNS_S = 14.0


def study(visit: Visit) -> None:
    visit.drawn(figures=4)


def signals(visit: Visit) -> None:
    """The start of the first move of three runs, the pointer in the figure."""
    visit.turn_to("Signals")
    visit.page.get_by_text("start of the first move").click()
    visit.drawn(figures=1)
    box = visit.page.locator(".nsewdrag").nth(1).bounding_box()
    assert box
    visit.page.mouse.move(box["x"] + 0.45 * box["width"], box["y"] + 0.5 * box["height"], steps=5)
    visit.page.get_by_role("columnheader").first.wait_for()


def plant(visit: Visit) -> None:
    """A load that is moved up and down, one picked up and slack let out."""
    visit.turn_to("Plant")
    page = visit.page
    page.get_by_role("button", name="Start the plant").click()
    page.get_by_text("Drum tension").wait_for()
    page.get_by_text("up and down", exact=True).click()
    time.sleep(0.6 * PLANT_RUNS_S)
    page.get_by_role("button", name="Pick up").click()
    time.sleep(0.2 * PLANT_RUNS_S)
    page.get_by_role("button", name="Let out").click()
    time.sleep(0.2 * PLANT_RUNS_S)


PAGES: dict[str, Callable[[Visit], None]] = {"study": study, "signals": signals, "plant": plant}


def main(names: list[str]) -> None:
    from PIL import Image

    if missing := browser.what_is_missing():
        raise SystemExit(missing)
    with (
        tempfile.TemporaryDirectory() as folder,
        browser.browser() as started,
        browser.dashboard(Path(folder) / "server") as address,
    ):
        for name in names or list(PAGES):
            with browser.visit(started, address, Path(folder)) as visit:
                visit.go()
                PAGES[name](visit)
                picture = Image.open(visit.shot(name)).convert("RGB")
            picture.quantize(COLOURS).save(IMAGES / f"{name}_page.png", optimize=True)
            print(IMAGES / f"{name}_page.png")


if __name__ == "__main__":
    main(sys.argv[1:])
