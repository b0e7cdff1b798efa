"""What makes figures of small and of turning machines legible."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support import axes
from workbench.analysis.loop import StepResponse
from workbench.machines import kind_of
from workbench.references import by_name
from workbench.view.loop import load_for
from workbench.view.style import GROUND, LINES, SPARE, line, on_dark

TURNING = axes.two_inertia()


def contrast(one: str, other: str) -> float:
    """WCAG 2.2: (L1 + 0.05)/(L2 + 0.05) of the relative luminances of two sRGB colours."""

    def luminance(colour: str) -> float:
        parts = [int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]
        linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    dark, light = sorted(luminance(colour) + 0.05 for colour in (one, other))
    return light / dark


@pytest.mark.parametrize("name", [*by_name(), *LINES, *(f"spare {k}" for k in range(len(SPARE)))])
def test_every_line_is_seen_on_both_grounds(name: str):
    number = int(name.split()[1]) if name.startswith("spare") else 0
    colour = line(name, number)["color"]
    assert contrast(colour, "#FFFFFF") >= 3.0 and contrast(on_dark(colour), GROUND) >= 3.0


@pytest.mark.parametrize(("fastest", "step"), [(0.5, 1.0), (270.0, 1e-3), (2.7e6, 1e-7)])
def test_a_load_step_leaves_an_axis_speed_below_one_unit(fastest: float, step: float):
    kind = kind_of(TURNING)
    answer = StepResponse(np.array([0.0, 1.0]), {kind.looped.speed: np.array([0.0, -fastest])})
    assert load_for(kind, [answer]) == pytest.approx(step) and fastest * step <= 1.0
