"""An axis' log in another unit is refused with the factor that would fit."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from workbench.core.errors import InputError
from workbench.logs import read_campaign

MACHINE = """\
kind: axis
motion: linear
mass_kg: 95.0
friction: {coulomb_forward_n: 20.0, coulomb_backward_n: 20.0, viscous_n_s_per_m: 200.0}
drive: {top_speed_m_s: 0.5, force_limit_n: 400.0}
"""
STEP_S = 0.001


def campaign(folder: Path, scales: dict[str, float], logged: tuple[str, ...], machine: str = MACHINE) -> Path:
    """A second's moves there and back, as an axis of this machine logs them, each signal times a scale."""
    chance = np.random.default_rng(3)
    time_s = np.arange(0.0, 6.0, STEP_S)
    position = 0.05 * (1.0 - np.cos(2.0 * np.pi * time_s / 1.5))
    velocity = np.gradient(position, STEP_S)
    force = 95.0 * np.gradient(velocity, STEP_S) + 200.0 * velocity + 20.0 * np.tanh(velocity / 1e-3)
    signals = {"position_m": position + chance.normal(0.0, 1e-6, len(time_s)), "velocity_m_s": velocity}
    signals["force_n"] = force + chance.normal(0.0, 1.0, len(time_s))
    columns = {"time_s": time_s, **{name: scales.get(name, 1.0) * signals[name] for name in (*logged, "force_n")}}
    rows = [",".join(columns), *(",".join(map(repr, map(float, row))) for row in zip(*columns.values(), strict=True))]
    (folder / "move.csv").write_text("\n".join(rows) + "\n")
    (folder / "machine.yaml").write_text(machine)
    (folder / "runs.yaml").write_text("runs: [{name: move, file: move.csv}]\n")
    return folder


BOTH = ("position_m", "velocity_m_s")


@pytest.mark.parametrize("logged", [BOTH, BOTH[:1], BOTH[1:]])
def test_an_axis_in_si_is_read(tmp_path: Path, logged: tuple[str, ...]):
    assert read_campaign(campaign(tmp_path, {}, logged)).all_notes == ()


def test_without_a_stated_drive_the_input_still_tells_millimetres(tmp_path: Path):
    plain = MACHINE.replace("drive: {top_speed_m_s: 0.5, force_limit_n: 400.0}\n", "")
    assert not read_campaign(campaign(tmp_path, {}, BOTH[:1], plain)).all_notes
    with pytest.raises(InputError, match=r"a scale of 0\.001 \(milli\) would fit for position_m"):
        read_campaign(campaign(tmp_path, {"position_m": 1e3}, BOTH[:1], plain))


@pytest.mark.parametrize(
    ("signal", "unit", "wrong", "logged"),
    [(*one, logged) for logged in (BOTH, BOTH[:1], BOTH[1:]) for one in (
        ("position_m", "mm", 1e3), ("position_m", "cm", 1e2), ("velocity_m_s", "mm/s", 1e3),
        ("velocity_m_s", "cm/s", 1e2), ("velocity_m_s", "m/min", 60.0), ("velocity_m_s", "mm/min", 6e4),
        ("force_n", "kN", 1e-3), ("force_n", "mN", 1e3),
    ) if one[0] in (*logged, "force_n")],
)  # fmt: skip
def test_a_scale_that_would_fit_makes_the_log_readable_and_the_right_one_is_offered(
    tmp_path: Path, signal: str, unit: str, wrong: float, logged: tuple[str, ...]
):
    """The refutation of the advice: it is followed, one offer after the other."""
    folder = campaign(tmp_path, {signal: wrong}, logged)
    with pytest.raises(InputError) as refused:
        read_campaign(folder)
    offers = re.findall(r"a scale of ([^,;]+) would fit(?: for (\w+))?", str(refused.value))
    right = False
    for scale, named in [(scale.split()[0], named) for scales, named in offers for scale in scales.split(" or ")]:
        column = named or re.findall(r"move: (\w+)", str(refused.value))[0]
        text = f"columns: {{{column}: {{column: {column}, scale: {scale}}}}}\nruns: [{{name: move, file: move.csv}}]\n"
        (folder / "runs.yaml").write_text(text)
        if column == signal and float(scale) == pytest.approx(1.0 / wrong, rel=1e-4):
            right = True
            assert read_campaign(folder).all_notes == (), unit
    assert right, refused.value
