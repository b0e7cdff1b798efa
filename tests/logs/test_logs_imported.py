"""Logs as drives write them: the same run in every format, several rates, units, and what cannot be read."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tests.support.commands import Commands
from tests.support.noisy_runs import hoist_runs
from workbench.core.errors import InputError
from workbench.core.run import Run
from workbench.logs import read_campaign
from workbench.logs.formats.declared import Channel
from workbench.logs.importing import NOMINAL, UNITS, UNSAID, propose, quantity_of, read_channels, unit_of
from workbench.machines import KINDS, Axis, Hoist, LinearAxis, default_hoist, save_machine

HOIST = default_hoist()
RPM = np.pi / 30.0


@cache
def run() -> Run:
    return hoist_runs(HOIST)[2]


def half(values: np.ndarray) -> np.ndarray:
    """Every second sample: a channel of half the rate."""
    return values[::2]


def as_mf4(file: Path) -> None:
    from asammdf import MDF, Signal

    r = run()
    mdf = MDF()
    mdf.append([Signal(r["torque_motor_nm"] / 1e3, r.time_s, unit="kNm", name="M_ist")])
    speed = half(r["speed_motor_rad_s"]) / RPM
    mdf.append([Signal(speed, half(r.time_s), unit="1/min", name="n_ist")])
    mdf.save(file)


def as_tdms(file: Path) -> None:
    from nptdms import ChannelObject, TdmsWriter

    r = run()
    with TdmsWriter(file) as writer:
        for name, values, unit, step in (
            ("Motor torque", r["torque_motor_nm"], "N m", 0.02),
            ("Motor speed", half(r["speed_motor_rad_s"]) / RPM, "rpm", 0.04),
        ):
            properties = {"wf_increment": step, "wf_start_offset": 0.0, "unit_string": unit}
            writer.write_segment([ChannelObject("Drive", name, values, properties)])


def as_mat73(file: Path) -> None:
    import h5py

    r = run()
    with h5py.File(file, "w", userblock_size=512) as held:
        for name, values in (
            ("t", r.time_s), ("motor_torque", r["torque_motor_nm"]), ("motor_speed", r["speed_motor_rad_s"]),
            ("gain", np.ones(1)),
        ):  # fmt: skip
            held.create_dataset(name, data=values[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
    with file.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512))


def comma(value: float) -> str:
    return f"{value:.9g}".replace(".", ",")


def as_scope(file: Path) -> None:
    """TwinCAT Scope: two groups of other rates, tabs, decimal commas, EOF."""
    r = run()
    ms, slow = 1e3 * r.time_s, 1e3 * half(r.time_s)
    speed = half(r["speed_motor_rad_s"]) / RPM
    lines = [
        "Name\tYT Scope Project", "File\tC:\\scope.svdx", "Starttime of export\t132960000000000000", "",
        "Name\tMAIN.fTorque\tName\tMAIN.fSpeed", "Data-Type\tREAL64\tData-Type\tREAL64",
        "SampleTime[ms]\t20\tSampleTime[ms]\t40", "Unit\tNm\tUnit\trpm", "",
    ]  # fmt: skip
    for k, (at, torque) in enumerate(zip(ms, r["torque_motor_nm"], strict=True)):
        late = f"{comma(slow[k])}\t{comma(speed[k])}" if k < len(slow) else "\t"
        lines.append(f"{comma(at)}\t{comma(torque)}\t{late}")
    file.write_text("\n".join([*lines, "EOF", ""]), encoding="utf-8")


def as_trace(file: Path) -> None:
    """Header lines, a row of units, semicolons, decimal commas, Western European letters."""
    r = run()
    lines = ["Trace;Antrieb_1", "Gerät;SINAMICS", "", "Zeit;Drehmoment;Drehzahl;Drehzahlsollwert", "ms;Nm;1/min;1/min"]
    for at, torque, speed in zip(1e3 * r.time_s, r["torque_motor_nm"], r["speed_motor_rad_s"] / RPM, strict=True):
        lines.append(";".join([comma(at), comma(torque), comma(speed), comma(speed)]))
    file.write_text("\r\n".join(lines), encoding="cp1252")


WRITERS = {"a.mf4": as_mf4, "a.tdms": as_tdms, "a.mat": as_mat73, "scope.csv": as_scope, "trace.csv": as_trace}


@pytest.mark.parametrize("name", WRITERS)
def test_a_run_comes_back_from_every_format_as_it_was(name: str, tmp_path: Path, commands: Commands):
    WRITERS[name](tmp_path / name)
    save_machine(HOIST, tmp_path / "machine.yaml")
    options = "--machine", tmp_path / "machine.yaml", "--payload", 9000, "--start-position", 11, "--yes"
    done = commands("import", tmp_path / name, "--out", tmp_path / "campaign", *options)
    assert done.status == 0, done.err
    (read,) = read_campaign(tmp_path / "campaign").runs
    expected = run()
    n = len(read.time_s)
    assert n >= len(expected.time_s) - 2 and read.payload_kg == 9000.0
    assert np.allclose(read.time_s, expected.time_s[:n], atol=1e-9)
    assert np.allclose(read["torque_motor_nm"], expected["torque_motor_nm"][:n], rtol=1e-6, atol=1e-4)
    k = np.arange(0, n, 2)  # the slow channel's own samples
    assert np.allclose(read["speed_motor_rad_s"][k], expected["speed_motor_rad_s"][:n][k], rtol=1e-6, atol=1e-5)
    page = (tmp_path / "campaign.import.html").read_text(encoding="utf-8")
    assert "speed motor (rad" in page


@pytest.mark.parametrize("name", WRITERS)
def test_a_file_that_is_cut_off_or_garbage_is_one_line(name: str, tmp_path: Path):
    file = tmp_path / name
    WRITERS[name](file)
    whole = file.read_bytes()
    for damaged in (whole[:64] + b"\xff\x00garbage" * 50, b""):
        file.write_bytes(damaged)
        said = refusal(file)
        assert said is None or (len(said.splitlines()) == 1 and name in said)
    assert refusal(file) is not None  # an empty one


def refusal(file: Path) -> str | None:
    """Half a text is a shorter log: it may well be read."""
    try:
        read_channels(file)
    except InputError as error:
        return str(error)
    return None


@pytest.mark.parametrize(
    ("title", "factor"), [("time_s", 1.0), ("t_ms", 1e-3), ("t [ms]", 1e-3), ("time", 1.0), ("Zeit_min", 60.0)]
)
def test_a_time_is_known_by_its_name_with_its_unit_behind(title: str, factor: float, tmp_path: Path):
    file = tmp_path / "log.csv"
    file.write_text(f"{title},speed_motor_rad_s\n" + "".join(f"{k},{k % 7}.5\n" for k in range(40)))
    (channel,) = read_channels(file)
    assert (channel.name, channel.time_s[-1]) == ("speed_motor_rad_s", pytest.approx(39.0 * factor))


def test_without_yes_it_asks_and_writes_nothing_where_the_answer_is_no(tmp_path, commands, monkeypatch):
    as_trace(tmp_path / "trace.csv")
    save_machine(HOIST, tmp_path / "machine.yaml")
    monkeypatch.setattr("click.termui.visible_prompt_func", lambda text: "n")
    options = "--machine", tmp_path / "machine.yaml", "--payload", 9000, "--start-position", 11
    done = commands("import", tmp_path / "trace.csv", "--out", tmp_path / "campaign", *options)
    assert done.status == 130 and "runs.yaml will be" in done.out
    assert not (tmp_path / "campaign").exists()


def test_a_log_that_no_campaign_can_be_made_of_leaves_no_folder(tmp_path: Path, commands: Commands):
    as_trace(tmp_path / "trace.csv")
    save_machine(HOIST, tmp_path / "machine.yaml")
    words = "import", tmp_path / "trace.csv", "--machine", tmp_path / "machine.yaml", "--out", tmp_path / "c", "--yes"
    done = commands(*words)
    assert done.status == 2 and "needs payload_kg" in done.err and not (tmp_path / "c").exists()
    twice = commands(*words, "--payload", 1, "--payload", 2)
    assert twice.status == 2 and "--payload: is given 2 times for 1 files" in twice.err
    wrong = commands(*words, "--map", "speed_motor_rad_s=Drezahl")
    assert wrong.status == 2 and "did you mean 'Drehzahl'" in wrong.err


def channels(*names: tuple[str, str]) -> list[Channel]:
    t = np.arange(3.0)
    return [Channel(name, unit, t, t) for name, unit in names]


def test_each_motor_has_its_torque_and_a_set_point_is_no_actual_value():
    made = propose(HOIST, channels(
        ("Temp motor 1", "Nm"), ("Torque motor 2", "Nm"), ("Torque motor 1", "Nm"), ("Speed setpoint", "rpm"),
        ("Speed actual", "rpm"), ("Carriage height", "mm"), ("Rope force", "kN"), ("Status", "")))  # fmt: skip
    assert {p.signal: p.column for p in made.proposals} == {
        "torque_motor1_nm": "Torque motor 1", "torque_motor2_nm": "Torque motor 2",
        "speed_motor_rad_s": "Speed actual", "speed_reference_rad_s": "Speed setpoint",
        "position_carriage_m": "Carriage height", "tension_dead_line_n": "Rope force",
    }  # fmt: skip
    assert {p.signal: p.factor for p in made.proposals}["position_carriage_m"] == 1e-3
    assert made.unused == ("Temp motor 1", "Status")


def test_every_signal_of_every_kind_has_a_quantity_with_a_unit():
    known = {quantity for quantity, _ in (unit_of(text) for text in ("s", "Nm", "rpm", "mm", "kN", "deg", "m/s"))}  # type: ignore[misc]
    for kind in KINDS.values():
        assert {quantity_of(signal) for signal in kind.signals.names} <= known


def test_units_and_scales_are_named_by_the_user_and_runs_by_a_table(tmp_path: Path, commands: Commands):
    """Torque in per cent of nominal, speed in rpm without its unit, date-times in place of a time."""
    r = run()
    nominal_nm = HOIST.motor.nominal_torque_nm * HOIST.motor.count
    begin = datetime(2026, 3, 1, 12, 0, 0, tzinfo=UTC)
    rows = ["Zeit;Drehmoment [%];n_ist"]
    for t, torque, speed in zip(r.time_s, r["torque_motor_nm"], r["speed_motor_rad_s"], strict=True):
        stamp = (begin + timedelta(seconds=round(float(t), 6))).isoformat(timespec="microseconds")
        rows.append(f"{stamp};{100.0 * torque / nominal_nm:.6f};{speed / RPM:.6f}")
    (tmp_path / "lift.csv").write_text("\n".join(rows))
    (tmp_path / "runs.csv").write_text(f"file,payload_kg,start_position_m,start_time_s\nlift,{r.payload_kg},9.0,60\n")
    save_machine(HOIST, tmp_path / "machine.yaml")
    words = [tmp_path / "lift.csv", "--machine", tmp_path / "machine.yaml", "--out", tmp_path / "out", "--yes"]
    words += ["--map", "torque_motor_nm=Drehmoment:%nominal", "--scale", f"speed_motor_rad_s={RPM!r}"]
    words += ["--runs", tmp_path / "runs.csv"]
    ended = commands("import", *words)
    assert ended.status == 0, ended.err
    (back,) = read_campaign(tmp_path / "out").runs
    assert (back.payload_kg, back.start_position_m, back.start_time_s) == (r.payload_kg, 9.0, 60.0)
    assert back.time_s == pytest.approx(r.time_s - r.time_s[0], abs=2e-6)
    assert back["torque_motor_nm"] == pytest.approx(r["torque_motor_nm"], abs=1e-3)
    assert back["speed_motor_rad_s"] == pytest.approx(r["speed_motor_rad_s"], abs=1e-5)


@pytest.mark.parametrize(
    ("mapped", "scales", "said"),
    [
        (["torque_motor_nm=M:rpm"], [], "'rpm' is no unit of torque_motor_nm"),
        (["torque_motor_nm=M:kn"], [], "did you mean 'knm'"),
        (["position_carriage_m=M:%nominal"], [], "states no nominal value of position_carriage_m"),
        ([], ["torque_motor_nm=0"], "expected SIGNAL=FACTOR"),
        ([], ["position_carriage_m=2"], "unknown or unmapped signal"),
    ],
)
def test_a_wrong_unit_or_scale_is_one_line(mapped: list[str], scales: list[str], said: str):
    time_s = np.arange(10.0)
    channels = [Channel(name, unit, time_s, time_s) for name, unit in (("M", "Nm"), ("n_ist", "1/min"))]
    with pytest.raises(InputError, match=said):
        propose(HOIST, channels, mapped, scales)


AXIS = LinearAxis.model_validate({
    "kind": "axis", "motion": "linear", "mass_kg": 95.0, "friction": {
        "coulomb_forward_n": 20.0, "coulomb_backward_n": 20.0, "viscous_n_s_per_m": 200.0},
    "drive": {"top_speed_m_s": 0.5, "force_limit_n": 400.0, "nominal_force_n": 300.0},
})  # fmt: skip


@pytest.mark.parametrize(
    ("machine", "signal", "other", "nominal", "least"),
    [
        (HOIST, "torque_motor_nm", "speed_motor_rad_s", HOIST.motor.nominal_torque_nm * HOIST.motor.count, 0.3),
        (HOIST, "speed_motor_rad_s", "torque_motor_nm", HOIST.motor.nominal_speed_rad_s, 0.0102),
        (AXIS, "force_n", "velocity_m_s", 300.0, 0.0102),
        (AXIS, "velocity_m_s", "force_n", 0.5, 0.0102),
    ],
    ids=["torque", "turning", "force", "speed"],
)
def test_no_unit_is_guessed_wrong_whatever_the_log_is_in_and_however_little_the_machine_does(
    machine: Hoist | Axis, signal: str, other: str, nominal: float, least: float
):
    """The refutation: every unit that may be left out, at every size from a hundredth to three times nominal; a hoist's
    torque from three quarters of what its empty carriage hangs by, 0.4 of nominal."""
    quantity, time_s, guesses = quantity_of(signal), np.linspace(0.0, 1.0, 200), set()
    units = {name: factor for name, (of, factor) in UNITS.items() if of == quantity and (name in UNSAID or factor == 1)}
    for unit, factor in (units | {NOMINAL: nominal / 100.0}).items():
        for size in np.geomspace(least, 2.98, 60):
            values = size * nominal / factor * np.ones(200)
            unnamed = [Channel(signal, "", time_s, values), Channel(other, "", time_s, time_s)]
            (made,) = (p for p in propose(machine, unnamed).proposals if p.signal == signal)
            assert made.by_size == "" or made.factor == pytest.approx(factor), (unit, size, made.by_size)
            guesses.add(made.by_size)
    assert len(guesses) > 1  # and some are made


TREND = [
    'Controller Name:,"Rig"', "Trend Name:,Lift", "Trend Tags:,2", "Sample Period:,20 ms", "Description:",
    "Start Time:,3/1/2026,11:59:59 PM;980", "", 'Header:,"Date","Time","Program:Main.Torque [Nm]","Speed_rpm"',
]  # fmt: skip


def test_a_trend_of_studio_5000_is_read_over_midnight(tmp_path: Path):
    clocks = ["23:59:59;980", "00:00:00;000", "00:00:00;020"]
    rows = [f"Data,{day}/1/2026,{at},{k}.5,{-k}" for k, (day, at) in enumerate(zip((3, 4, 4), clocks, strict=True))]
    (tmp_path / "trend.csv").write_text("\r\n".join([*TREND, *rows, ""]))
    torque, speed = read_channels(tmp_path / "trend.csv")
    assert (torque.name, torque.unit, speed.name) == ("Program:Main.Torque", "Nm", "Speed_rpm")
    assert np.diff(torque.time_s) == pytest.approx(0.02, abs=1e-6)
    assert torque.values.tolist() == [0.5, 1.5, 2.5] and speed.values.tolist() == [0.0, -1.0, -2.0]
    for wrong, said in (("Data,1,25,1,2", "expected Data, a date, a time"), ("Data,1,00:00:01;0,x,2", "numbers")):
        (tmp_path / "trend.csv").write_text("\n".join([*TREND, *rows, wrong]))
        with pytest.raises(InputError, match=said) as refused:
            read_channels(tmp_path / "trend.csv")
        assert refused.value.line == len(TREND) + 4
