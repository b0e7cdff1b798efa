"""What a kind of machine calls its quantities, and what is said of a log alike in every report."""

from __future__ import annotations

from dataclasses import dataclass

from workbench.logs import Campaign
from workbench.machines import Machine, kind_of

MOST_NOTES = 5


@dataclass(frozen=True)
class Words:
    """quantity: what drives the machine; unit: for people; suffix: for JSON keys; scale: what speeds are judged by."""

    quantity: str
    unit: str
    suffix: str
    scale: str


def words_of(machine: Machine) -> Words:
    kind = kind_of(machine)
    return Words(kind.drive.quantity, kind.drive.unit, kind.drive.suffix, kind.speed_scale[0])


def direction_names(machine: Machine) -> tuple[str, str]:
    return kind_of(machine).directions.names


def brief_notes(campaign: Campaign) -> list[str]:
    """The first few of the reader's notes."""
    notes = list(campaign.all_notes)
    if len(notes) <= MOST_NOTES:
        return notes
    return [*notes[:MOST_NOTES], f"and {len(notes) - MOST_NOTES} more notes like these"]
