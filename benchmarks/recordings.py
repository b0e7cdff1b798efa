"""`python -m benchmarks.recordings CLONES OUT`: public recordings of real machines, each as a campaign in OUT.

CLONES holds clones of the repositories of `SOURCES`, at the commit if one is named; what is missing there is left out,
and said so. Torque is the logged current times the constants of the data sheets beside the logs, or what the drive
itself makes of its current. Of servos whose voltage is a gain times the way to their goal it is that, and what their
motor induces is viscous friction. Each machine.yaml is a start: inertia, viscous friction, one Coulomb level for both
directions and a constant, by least squares over all runs below `BAND_HZ`, samples below `SLOWEST` of the top speed left
out; a sealed test of a recording identifies the machine on its runs anew.

Workbooks ask for openpyxl, which the project does not install.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import yaml
from scipy.io import loadmat

from workbench.core.run import Array
from workbench.simulate.lowpass import lowpass

SOURCES = {
    "HSM150-data": "malik-robert/HSM150-data",
    "Lorenz_Friction": "TeacherRock/Lorenz_Friction",
    "camber-control": "nicolazande/camber-control",
    "TTK4900_CDPR": "eliasoa/TTK4900_CDPR",
    "dynamic_calibration": "shamilmamedov/dynamic_calibration",
    "sysid": "kscalelabs/sysid at d66b22c",
    "bam": "Rhoban/bam at af22604",
    "actuator-dynamometer": "karthikurs/actuator-dynamometer at 1ab6e56",
    "TMotorCANControl": "neurobionics/TMotorCANControl at bb8d071",
    "Control-Lab---0-Inertia-and-Friction-Estimation":
        "giuliosavian/Control-Lab---0-Inertia-and-Friction-Estimation at d70f9b7",
    "Friction-Identification-for-Manipulators_usb2fdcan":
        "YIZHIXIAOCANGSHU/Friction-Identification-for-Manipulators_usb2fdcan at 4c6df01",
    "Robot_Identification": "JonasWeigand/Robot_Identification at 9e403c0",
    "TRO2021-Dynamic-Modelling": "RViMLab/TRO2021-Dynamic-Modelling at c3b758b",
    "dvrk_dynamics_identification": "WPI-AIM/dvrk_dynamics_identification at 7697d3a",
    "joint-friction-model": "HBRS-SDP/joint-friction-model at bf1c8d8",
}  # fmt: skip
SLOWEST = 0.05  # of the top speed
BAND_HZ = 10.0
INERTIA_KG_M2 = {"servo_bm": 1.5e-4, "servo_40": 1.5e-4}  # these hold their speed; the servo's other runs tell it
MILLI, DEGREE, RPM = 1e-3, math.pi / 180.0, 2.0 * math.pi / 60.0
# Nm of the motor a ampere, and N of the spindle a Nm: 50.95 and 327.6 turns a metre of the two linear actuators.
SPINDLE_N_PER_MA = 0.0706 * 2.0 * math.pi * 50.95 / 48.0
TOE_N_PER_A = 0.0461 * 1000.0 * 2.0 * math.pi * 327.6 / 42.0
CRANK_NM_PER_A = -0.0481 * 2.0 * math.pi * 24.06 / 48.0 * 180.0 / math.pi
WINCH_NM_PER_A = -8.27 / 150.0  # 5 kg on the drum of 20 mm take 0.98 Nm; going up the log has 1.04, coming down 0.87
ROBOT_NM_PER_A = 10.0, 10.6956, 8.4566, 9.0029, 9.48, 10.1232  # of each joint, from runs with a known load
# Of a gain of 1 rad: from the known mass of the pendulum, as the slope of the gain's torque over its weight's.
PENDULUM_NM = {"sts3250": 1.82, "sts3215": 1.27, "xl330": 0.002}
FREE_NM_PER_A = 1.3146  # at the output: what those of its logs that note a torque apply
GEARED_NM_PER_A = 14.0 * 7.68128e-3  # ratio and constant of its DATA.mat, before the gear's losses
LEADSCREW_M, LEADSCREW_NM_PER_A = 0.002, 9.84e-3
KINOVA_NM_PER_A, KINOVA_HZ = 7.6, 999.0  # of its constants.yml, the gear's ratio included
IDLE_S = 0.2  # no loop waits for its next sample so long
GRAVITY = {"robot_elbow", *PENDULUM_NM}  # these turn about an axis that lies
Signals = dict[str, Array]
Reader = Callable[[Path], Iterator[tuple[str, Signals]]]


def spin_ups(clones: Path) -> Iterator[tuple[str, Signals]]:
    for name in ("pos_0.06_1", "pos_0.06_2", "pos_0.065_1", "pos_0.065_2", "neg_0.04_1", "neg_0.04_2", "neg_0.045_1"):
        data = loadmat(str(clones / f"HSM150-data/Data/Identification/idf_{name}.mat"))["data"]
        yield name, {"time_s": data[:, 0], "angle_rad": data[:, 2], "speed_rad_s": data[:, 3],
                     "torque_nm": 0.0459 * data[:, 6]}  # fmt: skip


def servo(pattern: str) -> Reader:
    """Five repeats of one motion at 1 kHz."""

    def read(clones: Path) -> Iterator[tuple[str, Signals]]:
        for n in range(1, 6):
            data = np.loadtxt(clones / "Lorenz_Friction" / pattern.format(n))
            yield f"repeat_{n}", {"time_s": MILLI * np.arange(len(data), dtype=float), "angle_rad": data[:, 0],
                                  "speed_rad_s": data[:, 1], "angle_reference_rad": data[:, 2],
                                  "torque_nm": data[:, 4]}  # fmt: skip

    return read


def spindle(clones: Path) -> Iterator[tuple[str, Signals]]:
    root = clones / "camber-control/actuators/LinD/data"
    for folder in ("", "30xcurrent-4-100-0.045", "hc-10-1-0.035", "hc-5-100-0.08", "lc-4-50-0.075"):
        data = np.loadtxt(root / folder / "no-pp-square-wave-10mm-1Hz.txt")
        yield folder or "plain", {"time_s": MILLI * data[:, 0], "position_m": MILLI * data[:, 3],
                                  "velocity_m_s": MILLI * data[:, 4], "position_reference_m": MILLI * data[:, 1],
                                  "force_n": SPINDLE_N_PER_MA * data[:, 5]}  # fmt: skip


def _sheets(workbook: Path) -> Iterator[tuple[str, Array]]:
    """Columns time ms, reference, position, speed, current of each sheet that has more than a few rows."""
    from openpyxl import load_workbook  # type: ignore[import-untyped]

    for sheet in load_workbook(workbook, read_only=True, data_only=True).worksheets:
        rows = [[row[k] for k in (0, 3, 8, 13, 18)] for row in sheet.iter_rows(min_row=2, values_only=True) if row]
        known = [row for row in rows if all(isinstance(value, (int, float)) for value in row)]
        if len(known) > 100:
            yield sheet.title.split()[0].strip("- ") or sheet.title, np.array(known, dtype=float)


def toe(clones: Path) -> Iterator[tuple[str, Signals]]:
    for name, data in _sheets(clones / "camber-control/actuators/LinE/data/20251107_992GT3_Toe_New_PID_Tests.xlsx"):
        yield name, {"time_s": MILLI * data[:, 0], "position_m": MILLI * data[:, 2], "velocity_m_s": MILLI * data[:, 3],
                     "position_reference_m": MILLI * data[:, 1], "force_n": TOE_N_PER_A * data[:, 4]}  # fmt: skip


def crank(clones: Path) -> Iterator[tuple[str, Signals]]:
    book = "20251107_992GT3_Camber_Final_PID_Acc_Decel.xlsx"
    for name, data in _sheets(clones / "camber-control/actuators/EccB-180W/data" / book):
        yield name, {"time_s": MILLI * data[:, 0], "angle_rad": DEGREE * data[:, 2], "speed_rad_s": DEGREE * data[:, 3],
                     "angle_reference_rad": DEGREE * data[:, 1], "torque_nm": CRANK_NM_PER_A * data[:, 4]}  # fmt: skip


def winch(clones: Path) -> Iterator[tuple[str, Signals]]:
    """5 kg on a drum, half a turn to two and a half a second, about 30 Hz; what hands and the floor did is left out."""
    folder, columns = clones / "TTK4900_CDPR/Lifting_tests/5kg/ODrive2", (0, 3, 7, 11)  # of four drives the third
    for name, begin_s, end_s in (
        ("Down05", 0, 99),
        ("Up05", 0, 99),
        ("Down1", 12, 99),
        ("Up25", 0, 99),
        ("Down25", 0, 9),
    ):
        data = np.genfromtxt(folder / f"{name}.csv", delimiter=",", skip_header=1, usecols=columns)
        data = data[np.isfinite(data).all(axis=1) & (data[:, 0] > begin_s) & (data[:, 0] < end_s)]
        yield name, {"time_s": data[:, 0], "angle_rad": 2.0 * math.pi * data[:, 1],
                     "speed_rad_s": 2.0 * math.pi * data[:, 2], "torque_nm": WINCH_NM_PER_A * data[:, 3]}  # fmt: skip


def robot(joint: int) -> Reader:
    """One joint turns to and fro in 10 s, the five others rest; one log of a minute."""

    def read(clones: Path) -> Iterator[tuple[str, Signals]]:
        log = f"dynamic_calibration/dataset_ur10e/jointwise_motion/ur-20_01_22-joint_{joint}.csv"
        data = np.loadtxt(clones / log, delimiter=",")
        yield "sine", {"time_s": data[:, 0], "angle_rad": data[:, joint], "speed_rad_s": data[:, 6 + joint],
                       "torque_nm": ROBOT_NM_PER_A[joint - 1] * data[:, 12 + joint]}  # fmt: skip

    return read


def pendulum(name: str, folder: str, gains: tuple[int, ...], mass_kg: float, length_m: float) -> Reader:
    """A small servo swings a mass on an arm, 6 s a log at 200 Hz, each motion at each of some gains of its position."""

    def read(clones: Path) -> Iterator[tuple[str, Signals]]:
        logs = sorted((clones / folder).glob("*.json"))
        if not logs:
            raise FileNotFoundError(f"no logs in {clones / folder}")
        seen = dict[str, int]()
        for log in (json.loads(file.read_text(encoding="utf-8")) for file in logs if file.stat().st_size):
            known = log["mass"] == mass_kg and log["length"] == length_m and log["kp"] in gains
            if not known or log["trajectory"] not in ("sin_sin", "sin_time_square", "up_and_down"):
                continue
            motion = f"{log['trajectory']}_{log['kp']}"
            seen[motion] = seen.get(motion, 0) + 1
            time, angle, speed, goal = (
                np.array([row[column] for row in log["entries"]])
                for column in ("timestamp", "position", "speed", "goal_position")
            )
            yield f"{motion}_{seen[motion]}", {
                "time_s": time, "angle_rad": angle, "speed_rad_s": speed, "angle_reference_rad": goal,
                "torque_nm": PENDULUM_NM[name] * log["kp"] * (goal - angle)}  # fmt: skip

    return read


def drive(logs: str, columns: tuple[int, ...], runs: dict[str, str], nm_per_unit: float = 1.0) -> Reader:
    """What a drive notes of itself: `columns` of time, angle, speed, and torque or current; `runs` by what their logs
    put into `logs`. What comes before a pause of `IDLE_S`, waiting for the loop to run, is left out."""

    def read(clones: Path) -> Iterator[tuple[str, Signals]]:
        for run, name in runs.items():
            data = np.genfromtxt(clones / logs.format(name), delimiter=",", usecols=columns)
            data = data[np.isfinite(data).all(axis=1)]
            data = data[np.flatnonzero(np.diff(data[:, 0], prepend=-math.inf) > IDLE_S)[-1] :]
            yield run, {"time_s": data[:, 0], "angle_rad": data[:, 1], "speed_rad_s": data[:, 2],
                        "torque_nm": nm_per_unit * data[:, 3]}  # fmt: skip

    return read


def geared(clones: Path) -> Iterator[tuple[str, Signals]]:
    """A DC motor and its gear in stairs of 50 rpm and in triangles; of 1 kHz every fourth sample, for the log ends at
    20 Hz. Both triangles are labelled rpm; the first is in rad/s, as the motor's speed beside it says."""
    folder = clones / "Control-Lab---0-Inertia-and-Friction-Estimation/LAB0/Sim-Mat/Final_v"
    data, again = (loadmat(str(folder / file), simplify_cells=True) for file in ("DATA.mat", "MotorData_inertia.mat"))
    (current, speed, *_), (current_again, speed_again, *_) = data["MotorData"]["signals"], again["MotorData"]["signals"]
    for name, time, current_a, speed_rad_s in (
        ("stairs_up", data["t1"], data["cur1"], data["wl1"]),
        ("stairs_down", data["t2"], data["cur2"], data["wl2"]),
        ("triangles", data["t3"], current["values"], speed["values"]),
        ("triangles_again", again["MotorData"]["time"], current_again["values"], RPM * speed_again["values"]),
    ):
        yield name, {"time_s": time[::4], "speed_rad_s": speed_rad_s[::4],
                     "torque_nm": GEARED_NM_PER_A * current_a[::4]}  # fmt: skip


def joint_drive(motor: int) -> Reader:
    """A geared joint motor free on the bench: torque ramps until it breaks loose, speeds to 8 rad/s held, ramps; three
    rounds at 48 Hz, torque of its own feedback. Its position wraps at 12.5 rad and is left out."""

    def read(clones: Path) -> Iterator[tuple[str, Signals]]:
        rounds = clones / "Friction-Identification-for-Manipulators_usb2fdcan/results/runs/20260425_162832_identify-all"
        for number in (1, 2, 3):
            with np.load(rounds / f"group_0{number}/motor_0{motor}/capture.npz") as log:
                yield f"round_{number}", {"time_s": log["time"], "speed_rad_s": log["velocity"],
                                          "torque_nm": log["torque_feedback"]}  # fmt: skip

    return read


def big_robot(joint: int) -> Reader:
    """A robot that carries 300 kg, all its joints on the way of three trajectories of 10 s."""

    def read(clones: Path) -> Iterator[tuple[str, Signals]]:
        for letter in "ABC":
            folder = clones / f"Robot_Identification/data/recorded_trajectories/2020-10-21 10s FF {letter} 08ms"
            log, k = loadmat(str(folder / "data.mat"), simplify_cells=True), joint - 1
            rec, ratio = log["rec"], abs(log["para"]["u"][k])
            yield f"trajectory_{letter.lower()}", {
                "time_s": rec["time_cont"], "angle_rad": DEGREE * rec["act_pos_mot_deg"][k],
                "speed_rad_s": DEGREE * rec["act_vel_mot_deg_per_s"][k],
                "angle_reference_rad": DEGREE * rec["ref_pos_deg"][k],
                "torque_nm": ratio * rec["act_torque_abs_nm"][k]}  # fmt: skip

    return read


def surgical_arm(joint: int) -> Reader:
    """All joints of a surgical robot's arm on the way, 30 s at 200 Hz; the third is a slide."""

    def read(clones: Path) -> Iterator[tuple[str, Signals]]:
        folder = clones / "dvrk_dynamics_identification/data/psm/measured_trajectory"
        names = ("position_m", "velocity_m_s", "force_n") if joint == 3 else ("angle_rad", "speed_rad_s", "torque_nm")
        for run in ("one", "one_no_weight", "one_105_grams_parallel", "one_205_grams_parallel", "two"):
            data = np.loadtxt(folder / f"{run}_results.csv", delimiter=",")
            columns = data[:, joint - 1 :: data.shape[1] // 3]
            yield run, {"time_s": np.arange(len(data)) / 200.0, **dict(zip(names, columns.T, strict=True))}

    return read


def leadscrew(clones: Path) -> Iterator[tuple[str, Signals]]:
    """A screw that is nearly all friction, started and stopped at 25 Hz, and at even speeds; a few samples of rest."""
    turn = 2.0 * math.pi
    for name in (
        "start_stop/200",
        "start_stop/50",
        *(f"steady_state/0.096kg/{k}" for k in ("120", "n120", "60", "n60")),
    ):
        file = clones / f"TRO2021-Dynamic-Modelling/experiments/driveNo1/{name}.csv"
        lines = file.read_text(encoding="latin1").splitlines()
        first = next(k for k, line in enumerate(lines) if line.startswith("ms;")) + 1
        data = np.array([line.split(";") for line in lines[first:] if line.strip()], dtype=float)
        moves = np.flatnonzero(data[:, 1])
        time, speed, current = data[max(moves[0] - 12, 0) : moves[-1] + 12, :3].T
        yield name.replace("/0.096kg", "").replace("/", "_"), {
            "time_s": MILLI * time, "velocity_m_s": -RPM * speed * LEADSCREW_M / turn,
            "force_n": -current / 100.0 * LEADSCREW_NM_PER_A * turn / LEADSCREW_M}  # fmt: skip


def wrist(clones: Path) -> Iterator[tuple[str, Signals]]:
    """Each of ten speeds from rest, one way, 3 s."""
    for speed in (0.03, 0.05, 0.09, 0.10, 0.30, 0.50, 0.70, 0.90, 1.30, 1.50):
        data = np.genfromtxt(clones / f"joint-friction-model/data/velocity_{speed:f}readings.csv")
        yield f"speed_{speed:.2f}".replace(".", "_"), {
            "time_s": np.arange(len(data)) / KINOVA_HZ, "angle_rad": np.unwrap(data[:, 1]),
            "speed_rad_s": data[:, 2], "torque_nm": KINOVA_NM_PER_A * data[:, 5]}  # fmt: skip


FAMILIES: dict[str, Reader] = {
    "spin_ups": spin_ups,
    "servo": servo("data/Lorenz_Jm_{}.txt"),
    "servo_bm": servo("data/Lorenz_Bm_{}.txt"),
    "servo_s1": servo("Lorenz_id/Lorenz_id/data/data_S1_{}.txt"),
    "servo_40": servo("Lorenz_id/Lorenz_id/data/data_{}.txt"),
    "spindle": spindle,
    "toe": toe,
    "crank": crank,
    "winch": winch,
    "robot_base": robot(1),
    "robot_elbow": robot(3),
    "robot_wrist": robot(6),
    "sts3250": pendulum("sts3250", "sysid/data/feetech/STS_3250/processed", (4,), 0.535, 0.15),
    "sts3215": pendulum("sts3215", "sysid/data/feetech/STS_3215_12V_20250317/processed", (4,), 0.535, 0.15),
    "xl330": pendulum("xl330", "bam/bam/data.bak/processed", (100, 200, 400), 0.49, 0.1),
    # A gimbal motor and what hangs on its shaft, under random current.
    "bench_rotor": drive(
        "actuator-dynamometer/futek_data/futek_test_06_05_2021_{}.csv",
        (0, 4, 5, 6),
        {f"06_{clock}": clock for clock in ("14-28-13", "14-29-55", "17-09-17")},
    ),
    # Turns free: steps and a rising sweep of its position.
    "qdd_free": drive(
        "TMotorCANControl/src/TMotorCANControl/test/saved_logs/control_mode_tests/{}/log.csv",
        (0, 1, 2, 4),
        {
            name.removesuffix("_motorside"): name
            for name in (
                "mit_poscon",
                "full_state_feedback",
                "position_wraparound_test",
                "position_step_Kp10_Kd0.5_1rad",
                "position_step_Kp10_Kd0.5_10rad_motorside",
            )
        },
        FREE_NM_PER_A,
    ),
    "gear_motor": geared,
    "joint_drive": joint_drive(1),
    "small_drive": joint_drive(5),
    "kr300_base": big_robot(1),
    "kr300_wrist": big_robot(6),
    "psm_insertion": surgical_arm(3),
    "psm_yaw": surgical_arm(1),
    "leadscrew": leadscrew,
    "kinova_wrist": wrist,
}


def campaign(out: Path, runs: dict[str, Signals]) -> None:
    (out / "runs").mkdir(parents=True)
    listed, begin = [], 0.0
    for name, signals in runs.items():
        signals = signals | {"time_s": signals["time_s"] - signals["time_s"][0]}
        np.savetxt(out / f"runs/{name}.csv", np.column_stack(list(signals.values())), fmt="%.9g", delimiter=",",
                   header=",".join(signals), comments="")  # fmt: skip
        listed.append({"name": name, "file": f"runs/{name}.csv", "start_time_s": begin})
        begin += math.ceil(signals["time_s"][-1]) + 5.0
    (out / "runs.yaml").write_text(yaml.safe_dump({"runs": listed}), encoding="utf-8")
    (out / "machine.yaml").write_text(yaml.safe_dump(machine(out.name, list(runs.values()))), encoding="utf-8")


def machine(name: str, runs: list[Signals]) -> dict[str, object]:
    linear = "force_n" in runs[0]
    speed_of, unit, input_of = ("velocity_m_s", "n", "force_n") if linear else ("speed_rad_s", "nm", "torque_nm")
    top, rows, wanted = max(np.max(np.abs(run[speed_of])) for run in runs), [], []
    for run in runs:
        time = run["time_s"] + 1e-9 * np.arange(len(run["time_s"]))  # a log may note one instant twice
        speed = run[speed_of]
        wave = np.sin(run["angle_rad"]) if name in GRAVITY else np.zeros(len(speed))
        gaining = np.gradient(lowpass(time, speed, BAND_HZ), time)
        every = np.column_stack([gaining, speed, np.sign(speed), np.ones(len(speed)), wave, run[input_of]])
        passed = lowpass(time, every, BAND_HZ)[np.abs(speed) > SLOWEST * top]
        rows.append(passed[:, :-1])
        wanted.append(passed[:, -1])
    inertia, viscous, coulomb, constant, sine = map(float, np.linalg.lstsq(np.vstack(rows), np.concatenate(wanted))[0])
    inertia = INERTIA_KG_M2.get(name, inertia)
    least = 1e-9 * abs(inertia)
    slope = "viscous_n_s_per_m" if linear else "viscous_nm_s_per_rad"
    return {
        "name": name, "kind": "axis", "motion": "linear" if linear else "rotary",
        "mass_kg" if linear else "inertia_kg_m2": max(inertia, least),
        "gravity": {f"constant_{unit}": constant} | ({"sine_nm": sine} if name in GRAVITY else {}),
        "friction": {f"coulomb_forward_{unit}": max(coulomb, least), f"coulomb_backward_{unit}": max(coulomb, least),
                     slope: max(viscous, 0.0)},
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clones", type=Path)
    parser.add_argument("out", type=Path)
    given = parser.parse_args()
    for name, read in FAMILIES.items():
        try:
            runs = dict(read(given.clones))
        except FileNotFoundError as missing:
            print(f"{name}: left out, {missing}; clone {', '.join(SOURCES.values())} into {given.clones}")
            continue
        except ModuleNotFoundError as missing:
            print(f"{name}: left out, {missing}")
            continue
        campaign(given.out / name, runs)
        print(f"{name}: {len(runs)} runs, {sum(len(run['time_s']) for run in runs.values())} samples")


if __name__ == "__main__":
    main()
