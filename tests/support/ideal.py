"""The default machine behind an ideal drive: nothing between the wanted torque and the measured speed."""

from __future__ import annotations

from workbench.machines import DRIVES, Hoist, default_hoist


def ideal_hoist() -> Hoist:
    """For tests whose numbers are those of sampling alone."""
    return default_hoist().model_copy(update={"drive": DRIVES["ideal"]})
