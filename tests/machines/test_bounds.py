"""Every number of a file has bounds with a reason, and what lies beyond them is refused with a hint."""

from __future__ import annotations

from collections.abc import Iterator
from typing import get_args

import pytest
from pydantic import BaseModel

from workbench.core.errors import InputError
from workbench.core.yaml_strict import loads
from workbench.machines import default_hoist
from workbench.machines.files import RECORDS, machine_from, machine_text
from workbench.study.scenario import Scenario


def boundless(record: type[BaseModel], prefix: str = "") -> Iterator[str]:
    """Numbers that may be anything."""
    for name, field in record.model_fields.items():
        parts = (field.annotation, *get_args(field.annotation))
        metadata = [*field.metadata, *(m for part in parts for m in getattr(part, "__metadata__", ()))]
        flat = [inner for mark in metadata for inner in getattr(mark, "metadata", [mark])]
        if float in parts and not all(
            any(getattr(m, end, None) is not None for m in flat for end in ends)
            for ends in (("ge", "gt"), ("le", "lt"))
        ):
            yield f"{prefix}{name}"
        for part in parts:
            if isinstance(part, type) and issubclass(part, BaseModel):
                yield from boundless(part, f"{prefix}{name}.")


@pytest.mark.parametrize("record", [*RECORDS, Scenario])
def test_no_number_may_be_anything(record):
    assert list(boundless(record)) == []


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("  speed_delay_s: 5", "drive.speed_delay_s: 5, expected a number from 0 to 0.2; is it in milliseconds?"),
        ("  rotor_inertia_kg_m2: 8e299", "8e+299, expected a number from 1e-09 to 1e+09; is it in kg m²?"),
        ("  ratio: 1e308", "gearbox.ratio: 1e+308, expected a number from 0.001 to 100000"),
        ("  ratio: 1e-320", "gearbox.ratio: 1e-320, expected a number from 0.001 to 100000"),
        ("  ratio: -31", "gearbox.ratio: -31, expected a number greater than 0"),
        ("  coulomb_hoisting_n: -1", "guide.coulomb_hoisting_n: -1, expected a number of at least 0"),
    ],
)
def test_a_slip_of_units_is_refused_with_a_hint(line, said):
    key = line.split(":")[0]
    text = "\n".join(line if row.startswith(f"{key}:") else row for row in machine_text(default_hoist()).split("\n"))
    with pytest.raises(InputError) as refused:
        machine_from(loads(text, "machine.yaml"))
    assert said in str(refused.value)
