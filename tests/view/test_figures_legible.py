"""What makes figures of small and of turning machines legible."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from tests.support import axes
from workbench.analysis.loop import StepResponse
from workbench.machines import kind_of
from workbench.references import by_name
from workbench.view.loop import Step, _with_load
from workbench.view.place import marked_machine
from workbench.view.style import GROUND, LINES, SPARE, line, on_dark

SHRINK = SimpleNamespace(before=8.2e-5, after=2e-5, noise=1.9e-5, unit="N m")
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


@pytest.mark.parametrize(("fastest", "step"), [(0.5, "1"), (270.0, "0.001"), (2.7e6, "100·10⁻⁹")])
def test_a_load_step_leaves_an_axis_speed_below_one_unit(fastest: float, step: str):
    kind = kind_of(TURNING)
    answer = StepResponse(np.array([0.0, 1.0]), {kind.looped.speed: np.array([0.0, -fastest])})
    rows: tuple[Step, ...] = (
        ("speed_reference", "a", "speed<br>step of 1 rad/s", 1.0, "rad/s"),
        ("load_torque", "a", "speed (mrad/s)<br>1 N m on the axis", 1000.0, "mrad/s"),
    )
    first, load = _with_load(rows, kind, [answer])
    assert first == rows[0] and load[2] == f"speed (mrad/s)<br>{step} N m on the axis"
    assert fastest * load[3] <= 1000.0


def test_the_coupling_of_two_inertias_is_drawn_marked_and_named():
    drawing = marked_machine(TURNING, "gearbox", SHRINK)
    assert 'font-weight="bold">coupling</text>' in drawing and "gearbox" not in drawing
    assert "<circle" in drawing and "82·10⁻⁶ N m" in drawing


def test_a_linear_axis_is_drawn_along_its_rail_without_a_coupling():
    drawing = marked_machine(axes.emps(), "axis", SHRINK)
    assert "<circle" not in drawing and "coupling" not in drawing
