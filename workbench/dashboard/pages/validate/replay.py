"""The replay behind the page Validate, kept while neither campaign nor machine changes."""

from __future__ import annotations

from workbench.dashboard import session
from workbench.logs import Campaign
from workbench.machine.files import machine_text
from workbench.simulate.replay import ReplayResult, replay_runs

_KEPT = "validate replayed"
Question = tuple[object, ...]


def question(campaign: Campaign) -> Question:
    """What decides a replay's and an identification's numbers: the samples by identity, the machine by value."""
    return (tuple(id(run) for run in campaign.runs), machine_text(campaign.machine))


def replayed(campaign: Campaign) -> ReplayResult:
    """InputError for runs that cannot be replayed."""
    known = session.get(_KEPT, tuple, ())
    if known and known[0] == question(campaign):
        result: ReplayResult = known[1]
        return result
    result = replay_runs(campaign.machine, campaign.runs)
    # The campaign is kept with it, so that no other run can come to have the identity of one of these.
    session.put(_KEPT, (question(campaign), result, campaign))
    return result
