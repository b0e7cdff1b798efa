"""The dashboard's whole story in a real browser, with screenshots and times; its console stays free of errors.

WORKBENCH_SCREENSHOTS names a folder for the screenshots and measured.json; else they lie in pytest's temporary one.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import statistics
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.support import browser
from tests.support.browser import APP, SCRIPT, Visit
from tests.support.simulated_campaign import simulated_campaign, true_machine
from workbench.dashboard.shell import FIRST, PAGES
from workbench.effects import check
from workbench.machines import Hoist, load_machine

if TYPE_CHECKING:
    from playwright.sync_api import Page

# Of the slider: enough for a median where the times are wanted, else enough to see that figures follow.
MOVES = 9 if os.environ.get("WORKBENCH_SCREENSHOTS") else 3
DIAGNOSED_WITHIN_MS = 600_000.0
# Of the page Gap: the tabs with the figures that each shows; the downloads and what they are called.
TABS = {"Where it lies": 2, "Before and after": 3, "Told apart, next run": 1, "Control study": 1}
# The pages beside the first one that the whole story looks at, on a light ground.
WALKED = {"Compare", "Validate", "Gap", "Batches"}
DOWNLOADS = {"Report": "diagnose.html", "diagnosis.json": "diagnosis.json", "machine.yaml": "machine.yaml"}


@pytest.fixture
def shots(tmp_path: Path) -> Path:
    return Path(os.environ.get("WORKBENCH_SCREENSHOTS") or tmp_path / "screenshots").resolve()


def test_a_visitor_walks_the_whole_story(chromium, shots: Path, tmp_path: Path):
    measured: dict[str, object] = {"cores": os.cpu_count(), "load_average_before": os.getloadavg()[0]}
    with browser.dashboard(tmp_path / "server") as address, browser.visit(chromium, address, shots) as visit:
        measured["first_page_s"] = first_page(visit)
        measured["slider_to_figures_s"] = moves = sliders(visit)
        measured["slider_to_figures_median_s"] = statistics.median(moves)
        zoom(visit)
        compare(visit)
        validate(visit, simulated_campaign(tmp_path / "campaign"), tmp_path)
        gap(visit, tmp_path)
        batches(visit, tmp_path)
        assert visit.complaints == []
        assert visit.asked == []
    (shots / "measured.json").write_text(json.dumps(measured, indent=1))
    print(json.dumps(measured))


def first_page(visit: Visit) -> float:
    """Study on a server that nobody has visited yet; from the address to all figures drawn, in s: on a computer that
    others use too it says little, so only the browser's own waiting time ends a page that hangs."""
    visit.page.goto(visit.address, wait_until="commit")
    taken = visit.first_drawn_s(figures=1)
    visit.drawn()
    visit.shot("1 study")
    return taken


def sliders(visit: Visit) -> list[float]:
    """The jerk limit is moved to and fro; from each release to new figures."""
    jerk = visit.page.get_by_test_id("stSlider").filter(has_text="Limit jerk")
    taken = [visit.moved_ms(jerk, 0.12 if number % 2 == 0 else -0.08) / 1000.0 for number in range(MOVES)]
    visit.shot("2 study after sliders")
    return taken


def zoom(visit: Visit) -> None:
    """A stretch of time that the mouse has drawn out stays when a slider moves; a double click gives all back."""
    whole = visit.x_range()
    visit.zoom(0.2, 0.6)
    zoomed = visit.x_range()
    assert whole[0] < zoomed[0] < zoomed[1] < whole[1]
    visit.moved_ms(visit.page.get_by_test_id("stSlider").filter(has_text="Limit jerk"), 0.05)
    assert visit.x_range() == zoomed
    visit.shot("2 study zoomed")
    visit.page.locator(".nsewdrag").first.dblclick()
    visit.page.wait_for_function(f"window.bench.xRange()[1] > {zoomed[1]}")


def compare(visit: Visit) -> None:
    """Two settings are kept and stand side by side."""
    page = visit.page
    page.get_by_role("button", name="Keep for Compare").click()
    page.get_by_role("button", name="Kept").wait_for()
    visit.moved_ms(page.get_by_test_id("stSlider").filter(has_text="Limit acceleration"), -0.15)
    page.get_by_role("button", name="Keep for Compare").click()
    page.get_by_role("button", name="Kept").wait_for()
    visit.turn_to("Compare")
    visit.drawn(figures=2)
    heads = page.get_by_test_id("stTable").locator("th").all_inner_texts()
    assert len(heads) >= 3, heads
    visit.shot("3 compare")


def validate(visit: Visit, campaign: Path, tmp_path: Path) -> None:
    """A campaign is uploaded as a zip, replayed, identified; the identified machine is kept and downloaded."""
    packed = shutil.make_archive(str(tmp_path / "simulated"), "zip", campaign)
    page = visit.page
    visit.turn_to("Validate")
    visit.choose("Campaign", "upload a campaign")
    page.locator("input[type=file]").set_input_files(packed)
    page.get_by_text("Campaign simulated").wait_for(timeout=browser.DRAWN_WITHIN_MS)
    visit.drawn(figures=2)
    visit.shot("4 validate replay")
    page.get_by_role("button", name="Identify").click()
    page.get_by_text("Identified machine", exact=True).wait_for(timeout=browser.DRAWN_WITHIN_MS)
    visit.drawn(figures=2)
    visit.shot("5 validate identified")
    page.get_by_role("button", name="Keep the machine").click()
    with page.expect_download() as machine:
        page.get_by_role("button", name="machine.yaml").click()
    machine.value.save_as(tmp_path / "machine.yaml")
    identified = load_machine(tmp_path / "machine.yaml", check_effects=check)
    assert isinstance(identified, Hoist)
    truth = true_machine().guide.coulomb_hoisting_n
    assert identified.guide.coulomb_hoisting_n == pytest.approx(truth, rel=0.1)


def gap(visit: Visit, tmp_path: Path) -> None:
    """The campaign that ships is diagnosed, the page reloaded meanwhile; all is looked at, kept and downloaded."""
    page = visit.page
    visit.turn_to("Gap")
    visit.choose("Campaign", "demo_campaign")
    page.get_by_test_id("stButtonGroup").get_by_text("1 effect", exact=True).click()
    visit.drawn()
    visit.shot("6 gap before")
    page.get_by_role("button", name="Diagnose").click()
    page.get_by_text("Search the effects").wait_for(timeout=browser.DRAWN_WITHIN_MS)
    visit.shot("6 gap running")
    page.reload(wait_until="commit")
    page.get_by_text("The gap comes from friction_load_dependent").wait_for(timeout=DIAGNOSED_WITHIN_MS)
    visit.drawn(figures=2)
    visit.shot("7 gap verdict")
    for tab, figures in TABS.items():
        page.get_by_role("tab", name=tab).click()
        visit.drawn(figures)
        visit.shot(f"7 gap {tab.partition(',')[0].lower()}")
        if tab == "Where it lies":  # as words, which wrap: a run has many windows
            assert page.get_by_role("cell", name=re.compile(r"\d to \d.*, \d")).first.is_visible()
    page.get_by_role("button", name="Keep the machine").click()
    page.get_by_text("Kept as corrected by demo_campaign").wait_for()
    visit.drawn(figures=1)
    for button, name in DOWNLOADS.items():
        with page.expect_download() as file:
            page.get_by_role("button", name=button).click()
        assert file.value.suggested_filename == name
        file.value.save_as(tmp_path / "diagnosis" / name)
    said = json.loads((tmp_path / "diagnosis" / "diagnosis.json").read_text(encoding="utf-8"))
    assert (said["verdict"], said["effects"]) == ("named", ["friction_load_dependent"])
    assert "Diagnosis of" in (tmp_path / "diagnosis" / "diagnose.html").read_text(encoding="utf-8")
    corrected = load_machine(tmp_path / "diagnosis" / "machine.yaml", check_effects=check)
    assert list(corrected.effects) == ["friction_load_dependent"]
    visit.turn_to("Study")
    visit.choose("Machine", "corrected by demo_campaign")
    visit.drawn(figures=1)
    visit.shot("8 study corrected")


def batches(visit: Visit, tmp_path: Path) -> None:
    """A batch is started, found again after a reload of the page, opened; its report is downloaded."""
    page = visit.page
    visit.turn_to("Batches")
    page.get_by_test_id("stSidebar").get_by_role("button", name="Start").click()
    page.get_by_text("Torque peak per motor", exact=True).wait_for(timeout=browser.DRAWN_WITHIN_MS)
    address = page.url
    page.reload()
    page.get_by_text("Torque peak per motor", exact=True).wait_for(timeout=browser.DRAWN_WITHIN_MS)
    assert page.url == address
    visit.drawn()
    visit.shot("9 batches")
    page.get_by_role("tab", name="Figures").click()
    visit.drawn(figures=3)
    with page.expect_download() as report:
        page.get_by_role("button", name="Report").click()
    report.value.save_as(tmp_path / "report.html")
    assert report.value.suggested_filename == "payloads.html"
    assert "<title>Study payloads</title>" in (tmp_path / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(("start", "scheme"), [(APP, "dark"), (SCRIPT, "light")], ids=["workbench app", "app.py"])
def test_the_console_is_free_of_errors_and_nothing_is_asked_of_the_network(chromium, shots, tmp_path, start, scheme):
    with (
        browser.dashboard(tmp_path / "server", start) as address,
        browser.visit(chromium, address, shots / scheme, scheme) as visit,
    ):
        buttons: set[str] = set()
        visit.go(list(PAGES)[1])  # by its own address, on a server that nobody has visited
        for title in PAGES if scheme == "dark" else [title for title in PAGES if title not in WALKED]:
            visit.turn_to(title)
            visit.shot(title.lower())
            assert visit.page.get_by_test_id("stException").count() == 0, title
            buttons |= set(visit.page.evaluate(browser.BUTTONS))
        assert (buttons or scheme == "light") and not [said for said in buttons if "hare" in said or "loud" in said]
        visit.go(FIRST)  # which stands at the server's own address
        assert visit.complaints == []
        assert visit.asked == []


# What each control shows: label and value of every field, label and value of every slider.
SHOWN = """() => Object.fromEntries([
  ...[...document.querySelectorAll('[data-testid="stSidebar"] :is(input, textarea)')].filter(i => i.type !== 'file')
    .map((i, k) => [`${k} ${i.getAttribute('aria-label')}`, i.type === 'checkbox' ? i.checked : i.value]),
  ...[...document.querySelectorAll('[data-testid="stSidebar"] [role="slider"]')]
    .map((s, k) => [`slider ${k} ${s.getAttribute('aria-label')}`, s.getAttribute('aria-valuetext')]),
])"""


def at_rest(page: Page) -> dict[str, object]:
    """What the controls show once it has not changed for a second: a thumb glides to its place, on a busy computer a
    page goes on being drawn."""
    shown, end = page.evaluate(SHOWN), time.monotonic() + 60.0
    while time.monotonic() < end:
        time.sleep(1.0)
        now = page.evaluate(SHOWN)
        if now == shown:
            break
        shown = now
    return dict(shown)


TYPED = ":is([data-testid=stTextInput] input, [data-testid=stNumberInput] input, [data-testid=stTextArea] textarea)"
# Page -> figures that it shows; the pages where something can be typed.
EVERY = {"Loop": 4, "Signals": 1, "Plant": 0, "Import": 0, "Study": 1, "Sizing": 0}


@pytest.mark.parametrize(
    ("pages", "most"), [({"Loop": 4}, 3), pytest.param(EVERY, 1000, marks=pytest.mark.proof)], ids=["few", "every"]
)
def test_nonsense_that_is_mended_leaves_every_control_showing_what_is_used(chromium, tmp_path, pages, most):
    """In every field of every page, those that are folded away too; before a release."""
    with (
        browser.dashboard(tmp_path / "server") as address,
        browser.visit(chromium, address, tmp_path / "shots") as visit,
    ):
        page = visit.page
        visit.go()
        for title, figures in pages.items():
            visit.turn_to(title)
            side = page.get_by_test_id("stSidebar")
            while (folded := side.locator("details:not([open]) > summary")).count():
                folded.first.click()
                visit.drawn(figures)
            visit.drawn(figures)
            said, before = page.evaluate("window.bench.said()"), at_rest(page)
            fields = side.locator(f"{TYPED}:not([disabled])")
            assert fields.count() >= 2, title
            for number in range(min(fields.count(), most)):
                field = fields.nth(number)
                was = field.input_value()
                for typed in ("9000x", was):
                    for _ in range(5):  # what is typed while a busy computer still draws the field is lost
                        field.focus()
                        page.keyboard.press("Control+A")
                        page.keyboard.type(typed) if typed else page.keyboard.press("Delete")
                        if typed != was or field.input_value() == was:
                            break
                    page.keyboard.press(
                        "Control+Enter" if "textarea" in str(field.evaluate("e => e.tagName")).lower() else "Enter"
                    )
                    visit.drawn()
                assert page.get_by_test_id("stException").count() == 0, f"{title}: {field.get_attribute('aria-label')}"
            visit.drawn(figures)
            assert at_rest(page) == before, title
            assert page.evaluate("window.bench.said()") == said  # and what is used is what was used
        assert visit.complaints == []


def test_the_keyboard_alone_sets_up_keeps_and_compares_a_study(chromium, tmp_path: Path):
    with (
        browser.dashboard(tmp_path / "server") as address,
        browser.visit(chromium, address, tmp_path / "shots") as visit,
    ):
        page = visit.page
        visit.go()
        visit.drawn(figures=1)

        def tab_to(what: str) -> None:
            """Tab, until what has the focus is called so."""
            for _ in range(150):
                page.keyboard.press("Tab")
                name = page.evaluate("""() => {
                  const e = document.activeElement;
                  const control = e.matches('a, button, input, [role]');
                  return control ? `${e.getAttribute('aria-label')} ${e.textContent}` : '';
                }""")
                if what in name and not name.startswith("Help"):
                    return
            raise AssertionError(f"Tab never comes to {what}")

        def kept() -> None:
            tab_to("Keep for Compare")
            page.keyboard.press("Enter")
            page.get_by_role("button", name="Kept").wait_for()
            visit.drawn(figures=1)

        kept()
        before = page.evaluate("window.bench.said()")
        tab_to("Limit jerk")
        for _ in range(5):
            page.keyboard.press("ArrowRight")
        page.wait_for_function("before => window.bench.said() !== before", arg=before, polling=500)
        visit.drawn(figures=1)
        tab_to("Payloads (kg)")
        page.keyboard.type("3000")
        page.keyboard.press("Enter")
        page.keyboard.press("Escape")
        page.get_by_test_id("stMultiSelect").first.get_by_text("3000").wait_for()
        visit.drawn(figures=1)
        kept()
        tab_to("Compare")
        page.keyboard.press("Enter")
        visit.drawn(figures=2)
        assert page.get_by_test_id("stTable").locator("th").count() == 3
        assert visit.complaints == []


# What is cut: heads and values of cards, titles of figures, the page itself.
CUT = """() => {
  const main = document.querySelector('[data-testid="stMain"]');
  const cut = main.scrollWidth > main.clientWidth + 1 ? ['the page'] : [];
  for (const e of document.querySelectorAll('[data-testid="stMetricValue"] div, [data-testid="stMetricLabel"] p')) {
    if (e.scrollWidth > e.clientWidth + 1) cut.push(e.textContent);
  }
  for (const figure of document.querySelectorAll('.workbench-chart')) {
    const edge = figure.getBoundingClientRect();
    for (const e of figure.querySelectorAll('.gtitle, .annotation-text, .legendtext')) {
      const box = e.getBoundingClientRect();
      if (box.width && (box.right > edge.right + 4 || box.left < edge.left - 4)) cut.push(e.textContent);
    }
  }
  return cut;
}"""


@pytest.mark.parametrize(("width", "scheme"), [(800, "light"), (400, "dark")])
def test_a_narrow_page_cuts_nothing_and_leads_to_every_other(chromium, tmp_path, width, scheme):
    with (
        browser.dashboard(tmp_path / "server") as address,
        browser.visit(chromium, address, tmp_path / "shots", scheme) as visit,
    ):
        visit.page.set_viewport_size({"width": width, "height": 800})
        for title, figures in {"": 1, "Loop": 4, "Validate": 3, "Signals": 1, "Machine": 0}.items():
            visit.go(title)
            visit.drawn(figures)
            assert visit.page.evaluate(CUT) == [], title
            for value in visit.page.get_by_test_id("stMetricValue").all_inner_texts():  # no more digits than are read
                assert re.fullmatch(r"\N{MINUS SIGN}?(\d{1,4}|\d{1,2}\.\d{1,3}|\d{3}\.\d)( .{1,4})?", value), value
        if width < 768:
            visit.page.get_by_test_id("stExpandSidebarButton").click()
        else:
            visit.page.get_by_text(re.compile(r"^\d+ more$")).click()
        for title in PAGES:
            assert visit.page.get_by_text(title, exact=True).count() >= 1, title
        visit.page.get_by_text("Batches", exact=True).last.click()
        visit.page.get_by_text("No batch yet").wait_for()


def test_two_visitors_at_once_have_downloads_jobs_and_uploads_of_their_own(chromium, tmp_path: Path):
    packed = shutil.make_archive(str(tmp_path / "secret"), "zip", simulated_campaign(tmp_path / "campaign"))
    with (
        browser.dashboard(tmp_path / "server") as address,
        browser.visit(chromium, address, tmp_path / "one") as one,
        browser.visit(chromium, address, tmp_path / "two") as two,
    ):
        visits = {"first": one, "second": two}
        for name, visit in visits.items():
            visit.go()
            visit.drawn(figures=1)
            for fold in ("Scenario file", "Signals and report"):
                visit.page.get_by_text(fold, exact=True).click()
            visit.page.get_by_label("Name of the study").fill(name)
            visit.page.keyboard.press("Enter")
            visit.page.get_by_text(f"{name} ·").wait_for()
            visit.drawn(figures=1)
        for what, ending in (("Save scenario", "yaml"), ("Report", "html")):
            with one.page.expect_download() as a, two.page.expect_download() as b:  # asked for before either comes
                for visit in visits.values():
                    visit.page.get_by_role("button", name=what).click()
            for name, file in (("first", a), ("second", b)):
                assert file.value.suggested_filename == f"{name}.{ending}"
                assert name in Path(file.value.path()).read_text(encoding="utf-8")
        one.turn_to("Batches")
        one.page.get_by_test_id("stSidebar").get_by_role("button", name="Start").click()
        one.page.get_by_text("Torque peak per motor", exact=True).wait_for(timeout=browser.DRAWN_WITHIN_MS)
        one.turn_to("Signals")
        one.choose("Campaign", "upload a campaign")
        one.page.locator("input[type=file]").set_input_files(packed)
        one.page.get_by_text("Campaign secret").wait_for(timeout=browser.DRAWN_WITHIN_MS)
        one.drawn(figures=1)
        one.page.locator(".nsewdrag").first.click()  # a cursor that stays, and the other one's distance from it
        one.page.wait_for_function("(window.bench.figures()[0].layout.shapes ?? []).some(s => s.line.dash === 'dot')")
        one.page.locator(".nsewdrag").first.hover(position={"x": 20, "y": 20})
        one.page.get_by_role("columnheader").filter(has_text=re.compile(r"^[\d.]+ s \(.*\d s\)$")).wait_for()
        two.turn_to("Batches")
        two.page.get_by_text("No batch yet").wait_for()
        two.turn_to("Signals")
        two.page.get_by_test_id("stSelectbox").filter(has_text="Campaign").get_by_role("combobox").click()
        assert not any("secret" in name for name in two.page.get_by_role("option").all_inner_texts())
        two.page.keyboard.press("Escape")
        assert "work=" in one.page.url and "work=" not in two.page.url
        one.page.reload(wait_until="commit")  # in its own session the upload is found again, under its own name
        one.page.get_by_text("Campaign secret").wait_for(timeout=browser.DRAWN_WITHIN_MS)
        assert one.complaints == two.complaints == [] and one.asked == two.asked == []
