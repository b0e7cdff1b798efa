"""What a diagnosis is asked: the campaign, how many effects at once, which candidates; and its start as a job."""

from __future__ import annotations

from dataclasses import dataclass

import streamlit as st

from workbench.dashboard.campaigns import campaign_or_none, is_own, last_name
from workbench.dashboard.jobs.job import INPUTS, Call, Job, start
from workbench.dashboard.jobs.place import new_jobs_workspace
from workbench.effects import effects_for
from workbench.errors import InputError
from workbench.logs import Campaign
from workbench.plants import plant_of

KIND = "gap"
LISTED, ALL, OWN = "the listed effects", "all effects, the unlisted too", "my own choice"


@dataclass(frozen=True)
class Asked:
    """name: what the campaign's select box calls it. candidates: None for the listed ones."""

    campaign: Campaign
    name: str
    most_effects: int
    candidates: tuple[str, ...] | None


def asked() -> Asked | None:
    """What the controls say; None as long as a campaign is to be uploaded. InputError for a bad campaign."""
    campaign = campaign_or_none("gap campaign")
    if campaign is None:
        return None
    most = st.segmented_control(
        "Missing at once, at most", [1, 2], default=2, required=True, key="gap most effects",
        format_func=lambda count: f"{count} effect{'s' if count > 1 else ''}",
        help="Two at once takes longer, for pairs are weighed too.",
    )  # fmt: skip
    return Asked(campaign, last_name(), int(most or 2), _candidates(campaign))


def _candidates(campaign: Campaign) -> tuple[str, ...] | None:
    effects = effects_for(plant_of(campaign.machine).kind)
    listed = [name for name, effect in effects.items() if effect.listed]
    which = st.selectbox(
        "Candidates", [LISTED, ALL, OWN], key="gap candidates",
        help=f"What may be missing: {len(listed)} of the library's {len(effects)} effects are listed.",
    )  # fmt: skip
    if which == LISTED:
        return None
    if which == ALL:
        return tuple(effects)
    return tuple(st.multiselect("Effects to weigh", list(effects), listed[:1], key=f"gap own {campaign.machine.kind}"))


def begin(question: Asked) -> Job:
    """Starts the diagnosis. InputError where nothing is to be weighed, or too much is running."""
    if question.candidates == ():
        raise InputError("choose at least one effect to weigh", place="candidates")
    campaign = question.campaign
    # A session's own files go with it: the job gets a copy. The server's stay where they are.
    own = is_own(campaign)
    arguments = {
        "folder": f"{INPUTS}/campaign" if own else str(campaign.path.resolve()),
        "name": campaign.name,
        "most_effects": question.most_effects,
        "candidates": None if question.candidates is None else list(question.candidates),
    }
    what = Call("workbench.dashboard.pages.gap.work:run", arguments)
    return start(KIND, what, new_jobs_workspace(), question.name, {"campaign": campaign.path} if own else {})
