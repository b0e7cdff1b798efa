"""The dashboard in a real browser: `python -m benchmarks.pages [--sessions 20]`, on a computer that does nothing else.

Figures: from the address to verdict, table and first figure, and to the whole first page (all figures drawn, the script
ended), on a server that nobody has visited, at a second start, and warm: for the second visitor of a running server;
from a slider's release to new figures; frames a second of the page Machine; the server's CPU, per cent of a core, while
a page is open and nobody does anything; its memory with five sessions at once, after 100 moves of a slider, and after
each of many sessions that move sliders and are closed. One line of JSON.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tests.support import browser
from tests.support.browser import Visit

if TYPE_CHECKING:
    from playwright.sync_api import Browser

MOVES, FRAMES_S, IDLE_S = 5, 5.0, 10.0
KEPT_S = 5  # how long the server keeps a session that has gone; streamlit's own are 120 s

# Frames that the browser draws inside the page's drawing while it plays.
_FRAMES = """
seconds => new Promise(done => {
  let frames = 0;
  const start = performance.now();
  const each = now => {
    frames += 1;
    if (now - start < 1000 * seconds) requestAnimationFrame(each);
    else done(1000 * (frames - 1) / (now - start));
  };
  requestAnimationFrame(each);
})
"""


def first_page_s(started: Browser, address: str, home: Path) -> dict[str, float]:
    """Until verdict, table and the first figure are drawn, and until all is."""
    with browser.visit(started, address, home / "shots") as visit:
        visit.page.goto(address, wait_until="commit")
        first = visit.figures_drawn_s(1)
        return {"first_figure_s": round(first, 2), "whole_page_s": round(visit.first_drawn_s(figures=1), 2)}


BARE = """import plotly.graph_objects as go
import streamlit as st
st.plotly_chart(go.Figure(go.Scatter(x=[0, 1], y=[0, 1])))
"""


def bare_page_s(started: Browser, home: Path) -> dict[str, float]:
    """The same of the shortest Streamlit page with a Plotly figure: what no page of this kind can be quicker than."""
    home.mkdir(parents=True)
    (home / "bare.py").write_text(BARE, encoding="utf-8")
    words = ("-m", "streamlit", "run", str(home / "bare.py"), "--server.headless=true", "--server.port")
    with browser.dashboard(home, words) as address:
        first_page_s(started, address, home)
        return first_page_s(started, address, home)


def idle_percent(process: int) -> float:
    """Of a core: the CPU that a process takes in IDLE_S."""

    def cpu_s() -> float:
        user, system = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[11:13]
        return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")

    before = cpu_s()
    time.sleep(IDLE_S)
    return round(100.0 * (cpu_s() - before) / IDLE_S, 2)


def moved_s(visit: Visit, by: float) -> float:
    slider = visit.page.get_by_test_id("stSlider").filter(has_text="Limit jerk")
    return visit.moved_ms(slider, by) / 1000.0


def frames_per_s(visit: Visit) -> float:
    """Of the page Machine, as its own frame counts them."""
    visit.turn_to("Machine")
    frame = visit.page.locator("iframe").first.element_handle().content_frame()
    assert frame is not None
    return float(frame.evaluate(_FRAMES, FRAMES_S))


def memory_mb(process: int) -> float:
    """What a process holds in memory, and its children."""
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    own = next(int(line.split()[1]) for line in lines if line.startswith("VmRSS"))
    children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    return own / 1024.0 + sum(memory_mb(int(child)) for child in children)


def server_process(home: Path) -> int:
    """The process whose log lies there."""
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                environment = (entry / "environ").read_bytes()
            except OSError:
                continue
            if f"HOME={home}\0".encode() in environment:
                parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
                if parent == os.getpid():
                    return int(entry.name)
    raise RuntimeError("the server has gone")


def over_sessions(started: Browser, address: str, home: Path, sessions: int) -> list[float]:
    """The server's memory (MB) after each session, which moves a slider and looks at two pages more."""
    process, held = server_process(home), []
    for number in range(sessions):
        with browser.visit(started, address, home / "shots") as visit:
            visit.go()
            moved_s(visit, 0.02 + 0.01 * (number % 9))
            visit.turn_to("Loop")
            visit.turn_to("Machine")
        time.sleep(KEPT_S + 1.0)
        held.append(round(memory_mb(process), 1))
    return held


def five_at_once(started: Browser, address: str, home: Path, moves: int) -> tuple[float, float]:
    """The server's memory (MB) with five sessions open at once, and after so many moves of a slider in one of them."""
    process = server_process(home)
    with ExitStack() as open_:
        visits = [open_.enter_context(browser.visit(started, address, home / "shots")) for _ in range(5)]
        for visit in visits:
            visit.go()
        before = memory_mb(process)
        for number in range(moves):
            moved_s(visits[0], 0.03 if number % 2 == 0 else -0.02)
        return round(before, 1), round(memory_mb(process), 1)


def main(say: Callable[[str], None] = print) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=20)
    parser.add_argument("--moves", type=int, default=100)
    asked = parser.parse_args()
    sessions = asked.sessions
    if missing := browser.what_is_missing():
        raise SystemExit(missing)
    measured: dict[str, Any] = {"cores": os.cpu_count(), "load_average": round(os.getloadavg()[0], 2)}
    os.environ["STREAMLIT_SERVER_DISCONNECTED_SESSION_TTL"] = str(KEPT_S)
    with tempfile.TemporaryDirectory() as folder, browser.browser() as started:
        home = Path(folder) / "server"
        for start in ("first_start", "later_start"):
            with browser.dashboard(Path(folder) / start) as address:
                measured[start] = first_page_s(started, address, Path(folder) / start)
                measured["warm"] = first_page_s(started, address, Path(folder) / start)
        measured["bare_warm"] = bare_page_s(started, Path(folder) / "bare")
        with browser.dashboard(home) as address:
            with browser.visit(started, address, home / "shots") as visit:
                visit.go()
                moves = [moved_s(visit, 0.06 if number % 2 == 0 else -0.04) for number in range(MOVES)]
                measured["slider_to_figures_s"] = round(statistics.median(moves), 2)
                measured["idle_percent"] = idle_percent(server_process(home))
                measured["frames_per_s"] = round(frames_per_s(visit), 1)
            measured["five_sessions_mb"], measured["after_moves_mb"] = five_at_once(started, address, home, asked.moves)
            measured["memory_mb"] = over_sessions(started, address, home, sessions)
    say(json.dumps(measured))


if __name__ == "__main__":
    main()
