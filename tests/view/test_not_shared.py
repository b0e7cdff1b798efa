"""No figure can be sent to Plotly's cloud: the buttons of each kind of output, looked at in a browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.conftest import not_here
from tests.support import browser
from workbench.view.page import Section, save_page

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

# Where a figure would send itself.
SERVER = "() => document.querySelector('.js-plotly-plot')._context.plotlyServerURL"


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    if missing := browser.what_is_missing():
        not_here(missing)
    with browser.browser() as started:
        yield started


def figure() -> Any:
    from plotly.graph_objects import Figure

    return Figure({"data": [{"y": [1.0, 2.0]}]})


def looked_at(page: Page, file: Path, empty: bool = True) -> None:
    page.goto(file.as_uri())
    page.wait_for_selector(".modebar-btn", state="attached")
    titles = page.evaluate(browser.BUTTONS)
    assert titles and not [title for title in titles if "hare" in title or "loud" in title], titles
    if empty:
        assert page.evaluate(SERVER) == ""


def test_a_figure_of_plain_plotly_has_the_button_that_is_looked_for(chromium: Browser, tmp_path: Path):
    page = chromium.new_page()
    figure().write_html(tmp_path / "plain.html", include_plotlyjs=True)
    page.goto((tmp_path / "plain.html").as_uri())
    page.wait_for_selector(".modebar-btn", state="attached")
    assert any("Share" in title for title in page.evaluate(browser.BUTTONS))
    page.close()


def test_reports_and_studies_have_no_button_that_uploads(chromium: Browser, tmp_path: Path):
    from workbench.study.load import load_study
    from workbench.study.run import run_study
    from workbench.view.study import save_study_page

    page = chromium.new_page()
    save_page([Section(figures=[(figure(), "")])], tmp_path / "report.html", "report")
    looked_at(page, tmp_path / "report.html")
    study = load_study(Path(__file__).resolve().parents[2] / "scenarios" / "jog.yaml")
    save_study_page(run_study(study), tmp_path / "study.html")
    looked_at(page, tmp_path / "study.html")
    page.close()


def test_a_notebooks_figure_has_no_button_that_uploads(chromium: Browser, tmp_path: Path):
    from plotly.io import renderers
    from plotly.offline import get_plotlyjs

    import workbench

    cell = renderers["notebook"].to_mimebundle(workbench.loop().plot().to_dict())["text/html"]
    # The library is what the notebook has loaded by itself.
    page_of = f"<!doctype html><head><script>{get_plotlyjs()}</script></head><body>{cell}</body>"
    (tmp_path / "cell.html").write_text(page_of, encoding="utf-8")
    page = chromium.new_page()
    looked_at(page, tmp_path / "cell.html", empty=False)
    page.close()
