"""The study in the page's address, so that a link shows the same one: its YAML, compressed, in `?study=…`."""

from __future__ import annotations

import base64
import binascii
import zlib
from typing import cast

from workbench.dashboard.pages.study.axis.desk import AxisDesk, axis_desk_of
from workbench.dashboard.pages.study.axis.page import axis_text, shipped_as
from workbench.dashboard.pages.study.controls import Desk, desk_of, scenario_of
from workbench.effects import check
from workbench.errors import InputError
from workbench.kinds import LOOPED, looped, of_kind, studied
from workbench.machine import Axis, Hoist, default_hoist, machine_from, shipped
from workbench.machine.files import machine_text
from workbench.study.load import read_standalone, standalone_text
from workbench.study.scenario import Scenario
from workbench.yaml_strict import loads

KEY = "study"
LONGEST, MOST_BYTES = 6000, 100_000  # characters of the address; of the YAML in it
PLACE, FILE, BETWEEN = "the address", "machine.yaml", "\0"  # where both stand, the machine's file, what parts them


def in_address(scenario: Scenario, machine: Hoist) -> str | None:
    """What the address holds; None for the study that a page begins with, and for one too long for an address."""
    if scenario == scenario_of(Desk(), default_hoist()) and machine == default_hoist():
        return None
    return _packed(standalone_text(scenario, machine))


def axis_address(scenario: Scenario, machine: Axis) -> str | None:
    """The same of an axis' study: the scenario, and behind it the machine where that does not ship."""
    own = shipped_as(machine)
    return _packed(axis_text(scenario, own) if own else axis_text(scenario, FILE) + BETWEEN + machine_text(machine))


def from_address(text: str) -> tuple[Desk | AxisDesk, Hoist | Axis]:
    """The controls as a link sets them and the machine that they are of; a hoist's own values are in its scenario.

    InputError for an address that was cut or changed.
    """
    scenario, _, machine_yaml = _unpacked(text).partition(BETWEEN)
    machine = machine_from(loads(machine_yaml, PLACE), check_effects=check) if machine_yaml else None
    axis = None if machine is None or studied(machine) is not None else cast(Axis, machine)
    read = read_standalone(loads(scenario, PLACE), axis)
    named = axis or shipped(read.machine)
    if looped(named) is None:
        raise InputError(f"is of {of_kind(named)}; expected {LOOPED}", place=KEY)
    if studied(named) is not None:
        return desk_of(read, default_hoist()), default_hoist()
    return axis_desk_of(read, cast(Axis, named)), named


def _packed(text: str) -> str | None:
    packed = base64.urlsafe_b64encode(zlib.compress(text.encode(), 9)).decode().rstrip("=")
    return packed if len(packed) <= LONGEST else None


def _unpacked(text: str) -> str:
    wrong = InputError("is damaged; the address has to be copied whole", place=KEY)
    try:
        packed = base64.urlsafe_b64decode(text + "=" * (-len(text) % 4))
        unpacking = zlib.decompressobj()
        plain = unpacking.decompress(packed, MOST_BYTES)
        if not unpacking.eof:
            raise wrong
        return plain.decode()
    except (binascii.Error, zlib.error, ValueError) as error:
        raise wrong from error
