"""The study in the page's address, so that a link shows the same one: its YAML, compressed, in `?study=…`."""

from __future__ import annotations

import base64
import binascii
import zlib

from workbench.dashboard.pages.study.controls import Desk, desk_of, scenario_of
from workbench.errors import InputError
from workbench.machine import Hoist, default_hoist
from workbench.study.scenario.record import Scenario
from workbench.study.scenario.standalone import read_standalone, standalone_text
from workbench.yaml_strict import loads

KEY = "study"
LONGEST, MOST_BYTES = 6000, 100_000  # characters of the address; of the YAML in it


def in_address(scenario: Scenario, machine: Hoist) -> str | None:
    """What the address holds; None for the study that a page begins with, and for one too long for an address."""
    if scenario == scenario_of(Desk(), default_hoist()) and machine == default_hoist():
        return None
    packed = zlib.compress(standalone_text(scenario, machine).encode(), 9)
    text = base64.urlsafe_b64encode(packed).decode().rstrip("=")
    return text if len(text) <= LONGEST else None


def from_address(text: str) -> Desk:
    """The controls as a link sets them, on the default hoist; the machine's own values are in its scenario.

    InputError for an address that was cut or changed.
    """
    wrong = InputError("is damaged; the address has to be copied whole", place=KEY)
    try:
        packed = base64.urlsafe_b64decode(text + "=" * (-len(text) % 4))
        unpacking = zlib.decompressobj()
        plain = unpacking.decompress(packed, MOST_BYTES)
        if not unpacking.eof:
            raise wrong
        yaml = plain.decode()
    except (binascii.Error, zlib.error, ValueError) as error:
        raise wrong from error
    return desk_of(read_standalone(loads(yaml, "the address")), default_hoist())
