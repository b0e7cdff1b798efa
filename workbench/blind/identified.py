"""A machine.yaml as it is after commissioning: identified on plain runs, before anything ailed the machine."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from workbench.blind.sources.simulator.campaign import built, make_campaign
from workbench.blind.sources.simulator.content import Content
from workbench.blind.sources.simulator.kind import RunPlan
from workbench.identify.identify import identify
from workbench.logs import read_campaign
from workbench.machine import save_machine

_PLAIN = 0x1D  # a stream of its own: the noise of the plain runs is not that of the campaign


def identify_first(folder: Path, seeds: Sequence[int], content: Content) -> None:
    """Replaces the nominal machine.yaml of the campaign in `folder` by the one that `workbench identify` makes of two
    runs of the same true machine without its causes. RuntimeError where the engine gives up.
    """
    plain = replace(content, causes=(), runs=plain_runs(content.runs))
    with tempfile.TemporaryDirectory(prefix="workbench-plain-") as temporary:
        campaign = Path(temporary) / "plain"
        make_campaign(campaign, (*seeds, _PLAIN), plain, built(plain, seeds))
        machine = identify(read_campaign(campaign)).machine
    save_machine(machine, folder / "machine.yaml")


def plain_runs(runs: Sequence[RunPlan]) -> tuple[RunPlan, ...]:
    """Those of the lightest and of the heaviest payload; the first two where all carry the same."""
    loads = [run.payload_kg for run in runs]
    if min(loads) == max(loads):
        return tuple(runs[:2])
    return runs[loads.index(min(loads))], runs[loads.index(max(loads))]
