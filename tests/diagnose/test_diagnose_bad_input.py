"""What a diagnosis refuses and warns of, said plainly; and that it lets every recorded campaign pass."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.log_campaign import AXIS, write_campaign
from tests.support.simulated_campaign import simulated_campaign
from workbench.core.errors import InputError
from workbench.core.run import Array, Run
from workbench.diagnose.readiness.checks import check_runs, rigid_of
from workbench.diagnose.readiness.noise import informative_band
from workbench.effects.active import logged, of
from workbench.logs import Campaign, read_campaign
from workbench.machines import Hoist, with_values
from workbench.simulate.driven import InverseSimulation
from workbench.simulate.lowpass import lowpass

RPM = 60.0 / (2.0 * math.pi)
AXIS_RUNS = "runs:\n- {name: lift, file: runs/lift.csv}\n"


@pytest.fixture(scope="module")
def hoist(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    return read_campaign(simulated_campaign(tmp_path_factory.mktemp("checked") / "campaign"))


@pytest.fixture(scope="module")
def axis(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """Two runs of an axis at 1 kHz, its position logged only."""
    folder = tmp_path_factory.mktemp("axis") / "campaign"
    noise = np.random.default_rng(5)
    time = np.arange(4000) / 1000.0
    position = 0.1 * np.sin(2.0 * math.pi * time) + 0.04 * np.sin(2.0 * math.pi * 2.7 * time)
    speed, step = np.gradient(position, time), 1e-8
    force = 95.1089 * np.gradient(speed, time) + 20.39 * np.sign(speed) + 203.5 * speed
    columns = {
        "time_s": time.round(6),
        "force_n": force + noise.normal(scale=0.5, size=len(time)),
        "position_m": np.round(position / step) * step,
    }
    one = read_campaign(write_campaign(folder, columns, runs=AXIS_RUNS, machine=AXIS))
    return replace(one, runs=(*one.runs, replace(one.runs[0], name="again")))


def scaled(campaign: Campaign, which: Collection[str], **factors: float) -> Campaign:
    """The campaign with some runs' signals multiplied; both motors' torque goes with their sum."""

    def change(run: Run) -> Run:
        signals = dict(run.signals)
        for name, factor in factors.items():
            parts = [signal for signal in signals if signal.startswith("torque_motor")] if "torque" in name else [name]
            signals |= {signal: factor * signals[signal] for signal in parts}
        return replace(run, signals=signals)

    return changed(campaign, which, change)


def changed(campaign: Campaign, which: Collection[str], change: Callable[[Run], Run]) -> Campaign:
    return replace(campaign, runs=tuple(change(run) if run.name in which else run for run in campaign.runs))


def cut(campaign: Campaign, seconds: float) -> Campaign:
    def shorter(run: Run) -> Run:
        rows = run.time_s < run.time_s[0] + seconds
        return replace(run, time_s=run.time_s[rows], signals={k: v[rows] for k, v in run.signals.items()})

    return changed(campaign, [run.name for run in campaign.runs], shorter)


def refusal(campaign: Campaign) -> str:
    with pytest.raises(InputError) as refused:
        check_runs(campaign)
    assert "\n" not in str(refused.value)
    return str(refused.value)


ALL = ("empty", "half", "full")


def test_every_recorded_campaign_passes_without_a_word(campaigns: Path):
    folders = sorted(folder for folder in campaigns.iterdir() if (folder / "machine.yaml").is_file())
    assert len(folders) >= 33
    assert {folder.name: check_runs(read_campaign(folder)) for folder in folders} == {
        folder.name: () for folder in folders
    }


def test_a_speed_upside_down_is_said_with_the_runs(hoist: Campaign):
    said = refusal(scaled(hoist, ("empty", "full"), speed_motor_rad_s=-1.0))
    assert "speed rises against the torque in 2 of 3 runs (empty, full): is its sign flipped?" in said


def test_a_torque_upside_down_is_told_from_a_speed_upside_down(hoist: Campaign):
    said = refusal(scaled(hoist, ALL, torque=-1.0))
    assert "in all 3 runs (empty, half, full): is the sign of torque_motor_nm flipped?" in said


def test_torque_and_speed_that_both_count_downwards_are_said(hoist: Campaign):
    said = refusal(scaled(hoist, ("half",), torque=-1.0, speed_motor_rad_s=-1.0))
    assert "in 1 of 3 runs (half): are torque and speed both counted downwards?" in said


def test_a_speed_in_rpm_is_named_with_its_scale(hoist: Campaign):
    said = refusal(scaled(hoist, ("full",), speed_motor_rad_s=RPM))
    assert "is speed_motor_rad_s in rpm? Then give the column a scale of 0.10472" in said
    assert "in 1 of 3 runs (full)" in said


def test_runs_of_another_machine_are_named(hoist: Campaign):
    said = refusal(scaled(hoist, ("half",), torque=1.35))
    assert "run half disagrees with the machine and with the others" in said
    assert "is it of another machine, or is payload_kg wrong?" in said


def test_a_payload_stated_for_another_run_is_seen(hoist: Campaign):
    said = refusal(changed(hoist, ("full",), lambda run: replace(run, payload_kg=4500.0)))
    assert "run full disagrees" in said


def test_a_machine_file_of_another_machine_is_a_warning(hoist: Campaign):
    assert isinstance(hoist.machine, Hoist)
    other = replace(hoist, machine=with_values(hoist.machine, {"winch.drum_diameter_m": 0.9}))
    assert any("load is about 0.68 times what machine.yaml says" in text for text in check_runs(other))


def test_logs_of_half_a_second_are_refused_with_what_is_needed(hoist: Campaign):
    said = refusal(cut(hoist, 0.5))
    assert "empty lasts 0.49 s" in said
    assert "needs at least 2.3" in said


def test_motion_of_a_few_seconds_is_too_little(hoist: Campaign):
    assert "run moves for" in refusal(replace(cut(hoist, 6.0), runs=cut(hoist, 6.0).runs[:1]))


def _still(run: Run) -> Run:
    noise = np.random.default_rng(2).normal(scale=0.03, size=len(run.time_s))
    torque = 400.0 + np.random.default_rng(3).normal(scale=2.0, size=len(run.time_s))
    return replace(run, signals={**run.signals, "speed_motor_rad_s": noise, "torque_motor_nm": torque})


def test_a_campaign_of_standstill_is_refused(hoist: Campaign):
    assert "all runs stand still" in refusal(changed(hoist, ALL, _still))


def test_a_run_that_stands_still_among_others_is_a_warning(hoist: Campaign):
    warnings = check_runs(changed(hoist, ("half",), _still))
    assert "Run half stands still throughout and adds nothing to the diagnosis." in warnings


def test_what_one_run_cannot_show_is_said(hoist: Campaign):
    assert any("One run only" in text for text in check_runs(replace(hoist, runs=hoist.runs[:1])))


def test_runs_of_one_payload_are_a_warning(hoist: Campaign):
    again = replace(hoist.runs[0], name="again")
    warnings = check_runs(replace(hoist, runs=(hoist.runs[0], again)))
    assert any(text.startswith("All runs carry about 0 kg") for text in warnings)


def test_runs_of_one_direction_are_a_warning(hoist: Campaign):
    """The first lift of each run, a little over 4 s long."""
    assert any(text.startswith("All runs only hoist") for text in check_runs(cut(hoist, 5.5)))


def test_cruising_at_one_speed_is_a_warning(hoist: Campaign):
    assert any(text.startswith("All runs move at one speed") for text in check_runs(hoist))


def test_a_tension_in_kilonewton_is_refused(hoist: Campaign):
    def with_tension(run: Run) -> Run:
        weight = (8000.0 + run.payload_kg) * 9.81 / 2.0
        return replace(run, signals={**run.signals, "tension_dead_line_n": np.full(len(run.time_s), 1e-3 * weight)})

    assert "is it in kN" in refusal(changed(hoist, ("half",), with_tension))


def test_a_height_that_goes_the_other_way_is_refused(hoist: Campaign):
    def with_height(run: Run) -> Run:
        height = 9.0 - 0.0048 * np.cumsum(run["speed_motor_rad_s"]) * 0.01
        return replace(run, signals={**run.signals, "position_carriage_m": height})

    assert "position_carriage_m goes" in refusal(changed(hoist, ("full",), with_height))


def test_an_axis_passes_with_its_warning_only(axis: Campaign):
    assert check_runs(axis) == ()


def test_a_force_upside_down_on_an_axis_is_said(axis: Campaign):
    said = refusal(scaled(axis, ("again",), force_n=-1.0))
    assert (
        "speed rises against force_n in 1 of 2 runs (again): is the sign of force_n or of the motion flipped?" in said
    )


def test_a_position_in_millimetres_is_said(axis: Campaign):
    assert "is force_n or the motion in another unit" in refusal(scaled(axis, ("lift", "again"), position_m=1e3))


def test_axes_of_two_masses_are_not_one_machine(axis: Campaign):
    said = refusal(scaled(axis, ("again",), force_n=2.0))
    assert "disagree" in said and "inertia" in said


def test_a_frozen_force_is_said(axis: Campaign):
    def frozen(run: Run) -> Run:
        return replace(run, signals={**run.signals, "force_n": np.full(len(run.time_s), 12.0)})

    assert "force_n is 12 throughout while the machine moves" in refusal(changed(axis, ("again",), frozen))


def test_speed_and_position_that_contradict_each_other_are_refused(axis: Campaign):
    def with_speed(run: Run) -> Run:
        return replace(run, signals={**run.signals, "velocity_m_s": -np.gradient(run["position_m"], run.time_s)})

    assert "position_m changes -1 times as fast as velocity_m_s says" in refusal(changed(axis, ("lift",), with_speed))


@pytest.mark.parametrize("stride", [1, 2])
def test_units_are_seen_at_fifty_hertz_too(hoist: Campaign, stride: int):
    """100 and 50 Hz."""

    def thinned(run: Run) -> Run:
        return replace(
            run, time_s=run.time_s[::stride], signals={name: values[::stride] for name, values in run.signals.items()}
        )

    slow = changed(hoist, ALL, thinned)
    check_runs(slow)
    assert "in rpm" in refusal(scaled(slow, ALL, speed_motor_rad_s=RPM))


def test_a_force_that_shakes_as_much_as_it_accelerates_says_nothing_of_units(axis: Campaign):
    def shaken(run: Run, share: float) -> Run:
        speed = lowpass(run.time_s, np.gradient(run["position_m"], run.time_s), 10.0)
        force = 6.0 * 95.1089 * np.gradient(speed, run.time_s)
        wave = share * np.std(force) * np.sqrt(2.0) * np.sin(2.0 * np.pi * 3.1 * run.time_s)
        return replace(run, signals={**run.signals, "force_n": force + wave})

    runs = ("lift", "again")
    assert "in another unit" in refusal(changed(axis, runs, lambda run: shaken(run, 0.1)))
    assert not any("unit" in warning for warning in check_runs(changed(axis, runs, lambda run: shaken(run, 1.0))))


def dahl(position: Array, distance: float) -> Array:
    """Friction over its level that builds up over a distance: dz/dx = (1 − |z| sgn(z v))/distance."""
    bend, before = np.zeros(len(position)), 0.0
    for k, step in enumerate(np.diff(position, prepend=position[0]) / distance):
        before = bend[k] = (before + step) / (1.0 + abs(step))
    return bend


def test_friction_that_follows_the_position_of_a_slow_run_is_no_wrong_sign(axis: Campaign):
    """Each run against a friction that builds up over 20 mm; the second, slow one shows hardly anything else."""

    def run(name: str, size: float, flipped: float = 1.0) -> Run:
        first = axis.runs[0]
        time = first.time_s
        position = size * (1.0 - np.cos(math.pi * np.minimum(time, 2.0))) + 1e-5 * np.sin(9.0 * time)
        position = position if name == "slow" else first["position_m"]
        force = 95.1089 * np.gradient(np.gradient(position, time), time) + 200.0 * dahl(position, 0.02)
        return replace(first, name=name, signals={"position_m": position, "force_n": flipped * force})

    slow = replace(axis, runs=(run("quick", 0.0), run("slow", 0.015)))
    bench = InverseSimulation(slow.machine, slow.runs)
    quick, bent = (rigid_of(bench, j) for j in range(2))
    assert quick.inertia == pytest.approx(1.0, abs=0.1) and bent.inertia is None
    check_runs(slow)
    assert "speed rises against force_n" in refusal(replace(axis, runs=(run("quick", 0.0, -1.0), run("slow", 0.015))))


def test_the_band_of_an_axis_ends_where_its_motion_is_not_the_inputs_work(axis: Campaign):
    """A machine shaken at 30 to 70 Hz, by 2 m/s²: by its drive, and by something that the log does not show."""
    run = axis.runs[0]
    time = run.time_s
    shaken = 2.0 * lowpass(time, np.random.default_rng(3).normal(size=len(time)), 70.0)
    shaken -= lowpass(time, shaken, 30.0)
    turn = 2.0 * math.pi * np.fft.rfftfreq(len(time), 0.001)
    moved = np.fft.irfft(np.fft.rfft(shaken) / -(np.maximum(turn, 2.0 * math.pi) ** 2), len(time))
    by_drive, by_itself = (
        replace(run, signals={"position_m": run["position_m"] + moved, "force_n": run["force_n"] + mass * shaken})
        for mass in (95.1089, 0.0)
    )
    whole = informative_band(InverseSimulation(axis.machine, [by_drive]), 0)
    assert whole > 60.0
    assert 20.0 < informative_band(InverseSimulation(axis.machine, [by_itself]), 0) < 33.0
    light = replace(by_drive, signals={**by_drive.signals, "force_n": 0.5 * by_drive["force_n"]})
    late = replace(by_drive, signals={**by_drive.signals, "force_n": np.roll(by_drive["force_n"], 5)})
    for run_of_gap in (light, late):  # a gap is no reason to look away
        assert informative_band(InverseSimulation(axis.machine, [run_of_gap]), 0) == pytest.approx(whole, rel=0.3)


def test_the_band_of_a_real_pendulum_is_the_same_for_a_late_log(shared_data: Path):
    """Beyond 5 Hz its torque is a twentieth of what its noisy motion asks for. A log that is late by a part of a sample
    has its noise smoothed: that is no motion either."""
    pendulum = read_campaign(shared_data / "real" / "geared_pendulum")
    late = [logged(run, of(pendulum.machine, {"speed_delay": {"delay_s": 0.036}})) for run in pendulum.runs]
    bands = [informative_band(InverseSimulation(pendulum.machine, runs), 0) for runs in (pendulum.runs, late)]
    assert min(bands) > 3.0 and max(bands) < 6.5
