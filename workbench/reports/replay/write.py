"""What `workbench replay` puts into --out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from workbench.logs import Campaign
from workbench.reports.replay import report
from workbench.reports.replay.page import save_replay_page
from workbench.simulate.replay import ReplayResult
from workbench.whole_folder import check_free, whole_folder, write_json


def write_replay(run: Callable[[], ReplayResult], campaign: Campaign, folder: Path) -> ReplayResult:
    """Replay, and write replay.json and replay.html; all or nothing, see `whole_folder`."""
    check_free(folder)
    with whole_folder(folder) as hidden:
        result = run()
        write_json(hidden / "replay.json", report.to_json(campaign, result))
        save_replay_page(campaign, result, hidden / "replay.html")
    return result
