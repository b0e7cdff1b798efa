"""The kinds of machine that campaigns are made of, alike to whoever orders them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.campaigns import campaign, content, listed, size, unlisted
from benchmarks.campaigns.axis import campaign as axis_campaign
from benchmarks.campaigns.axis import content as axis_content
from benchmarks.campaigns.axis import listed as axis_listed
from benchmarks.campaigns.axis import size as axis_size
from benchmarks.campaigns.axis import unlisted as axis_unlisted
from benchmarks.campaigns.campaign import Label
from benchmarks.campaigns.size import Change

Seeds = Sequence[int]


@dataclass(frozen=True)
class Family:
    """machines: what --machines calls them; usual: the effects that show on such; pair: two from one of them.

    made: writes a campaign of (folder, seed, kind, effects, machines); its label, and how large its causes are.
    """

    machines: tuple[str, ...]
    usual: Callable[[str], tuple[str, ...]]
    unlisted: tuple[str, ...]
    pair: Callable[[np.random.Generator, str, str], tuple[str, str]]
    made: Callable[[Path, Seeds, str, Sequence[str], str], tuple[Label, Change | None]]

    def labelled(self, folder: Path, seed: Seeds, kind: str, names: Sequence[str], machines: str) -> Label:
        """Makes the campaign; its whole label."""
        label, change = self.made(folder, seed, kind, names, machines)
        if change is None:
            return label
        return replace(label, torque_change_rms_nm=change.rms_nm, torque_change_by_second_nm=change.by_second_nm)


def _hoist(folder: Path, seed: Seeds, kind: str, names: Sequence[str], machines: str) -> tuple[Label, Change | None]:
    drawn = content.draw(seed, kind, names=names, machines=machines)
    label = campaign.make_campaign(folder, seed, drawn)
    return label, size.torque_change(drawn, seed) if drawn.causes else None


def _axis(folder: Path, seed: Seeds, kind: str, names: Sequence[str], machines: str) -> tuple[Label, Change | None]:
    drawn = axis_content.draw(seed, kind, names=names, motion=machines)
    label = axis_campaign.make_campaign(folder, seed, drawn)
    return label, axis_size.force_change(drawn, seed) if drawn.causes else None


HOISTS = Family(
    content.MACHINES,
    lambda machines: listed.USUAL,
    tuple(unlisted.UNLISTED),
    lambda rng, machines, first: content.drawn_pair(rng, first),
    _hoist,
)
AXES = Family(axis_content.AXES, axis_listed.usual, tuple(axis_unlisted.UNLISTED), axis_listed.drawn_pair, _axis)
MACHINES = (*HOISTS.machines, *AXES.machines)


def family_of(machines: str) -> Family:
    return AXES if machines in AXES.machines else HOISTS
