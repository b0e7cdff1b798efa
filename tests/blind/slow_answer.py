"""A diagnosis that takes half a second, for a test that stops it."""

from __future__ import annotations

import time
from pathlib import Path

from workbench.blind.answer import Answer, text_of


def slow(campaign: Path) -> str:
    if campaign.name > "001":
        time.sleep(1.5)
    return text_of(Answer(campaign.name, "no_gap", ranking=[("no_gap", [], 1.0)], kind="hoist"))
