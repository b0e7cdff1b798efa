"""`python -m benchmarks.run`: replay, closed loop, batch and fit, each beside its peers at their best setting.

A setting is the fastest found that meets ACCURACY on this signal, among relative and
absolute tolerances from 1e-4 to 1e-11 and step limits from none to one log interval.
An absolute tolerance alone served best: a relative one spends its steps on the large angles.
It prints the table and writes results.json.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence

import numpy as np
from rich.console import Console

from workbench.core.table import Column, Table, words

from . import ours
from .case import FITTED, PAYLOAD_KG, Loop, make_batch, make_fit_log, make_loop, make_replay, solve_loop
from .hoist import Floats, load_hoist, speed_error
from .measure import ACCURACY, FIT_ACCURACY, RESULTS, Measured, Row, Work, in_turns
from .peers import casadi_sim, cvode, python_control, scipy_ivp

BATCH_PER_SECOND = 500.0
BUSY = 1.1  # clock time over CPU time
OURS = "workbench"
BATCH_JUDGED = (0, 21, 42, 63)  # corners and middle of the batch, solved by the reference too
CASADI_BATCH = 8


# peer -> (setting in words, ratio to reach)
Peers = dict[str, tuple[str, float | None]]


def _rows(name: str, measured: dict[str, Measured], peers: Peers) -> list[Row]:
    return [Row(name, measured[OURS], peer, measured[peer], *peers[peer]) for peer in peers]


def replay_rows(torque_nm: Floats, rounds: int = 5) -> list[Row]:
    """49.76 s of torque at 100 Hz in, motor speed out at the log's samples."""
    case = make_replay(load_hoist(PAYLOAD_KG), torque_nm)
    bench = ours.read(case)
    integrator = casadi_sim.make_replay(case, 1e-11, 3e-7)

    def error(speed: Floats) -> float:
        return speed_error(speed, case.speed_rad_s)

    measured = in_turns(
        {
            OURS: Work(lambda: ours.replay(bench), error, quick=True),
            "scipy-bdf": Work(lambda: scipy_ivp.replay(case, "BDF", 1e-11, 3e-7, np.inf), error),
            "scipy-lsoda": Work(lambda: scipy_ivp.replay(case, "LSODA", 1e-11, 1e-6, 0.02), error),
            "cvode": Work(lambda: cvode.replay(case, 1e-11, 5e-7, 0.0), error),
            "python-control": Work(lambda: python_control.replay(case, 1e-11, 1e-6, 0.05), error),
            "casadi": Work(lambda: casadi_sim.replay(case, integrator), error),
        },
        rounds,
    )
    peers: Peers = {
        "scipy-bdf": ("Python rhs, atol 3e-7", 500.0),
        "scipy-lsoda": ("Python rhs, atol 1e-6, step <= 0.02 s", 100.0),
        "cvode": ("scikit-sundae BDF, Python rhs, atol 5e-7", 30.0),
        "python-control": ("input_output_response, LSODA, atol 1e-6, step <= 0.05 s", 400.0),
        "casadi": ("its CVODES, symbolic rhs and Jacobian, atol 3e-7", None),
    }
    return _rows("replay", measured, peers)


def model_rows(torque_nm: Floats, rounds: int = 3) -> list[Row]:
    """The same torque on the multi-body machine: another model, so its error is the two models' distance.

    The ratio aimed at is the paper's: its multi-body model took 26 times as long as its analytical one.
    """
    case = make_replay(load_hoist(PAYLOAD_KG), torque_nm)
    bench = ours.read(case)

    def error(speed: Floats) -> float:
        return speed_error(speed, case.speed_rad_s)

    measured = in_turns(
        {
            OURS: Work(lambda: ours.replay(bench), error, quick=True),
            "multibody": Work(lambda: ours.multibody_replay(case), error),
        },
        rounds,
    )
    return _rows("models", measured, {"multibody": ("Exudyn, generalised-alpha, 4 ms: another model", 26.0)})


def loop_rows(case: Loop, speed_rad_s: Floats, rounds: int = 3) -> list[Row]:
    """49.76 s under a PI at 1 kHz; every tenth sample kept, the error over all of them."""
    cases = ours.loop_cases([case])
    rolled = casadi_sim.make_loop(case, 4)

    def error(speed: Floats) -> float:
        return speed_error(speed, speed_rad_s)

    def own_error(_: object) -> float:
        return error(ours.speed_of(ours.closed_loops(cases, 1)[0]))

    measured = in_turns(
        {
            OURS: Work(lambda: ours.closed_loops(cases, 10), own_error, quick=True),
            "scipy-lsoda": Work(lambda: scipy_ivp.closed_loop(case, 1e-4, 1e-4), error),
            "casadi": Work(lambda: casadi_sim.closed_loops(rolled, [case])[0], error),
        },
        rounds,
    )
    peers: Peers = {
        "scipy-lsoda": ("solve_ivp restarted at all 49,760 samples, rtol = atol = 1e-4", 1000.0),
        "casadi": ("RK4, 4 steps a sample, rolled out by mapaccum", None),
    }
    return _rows("closed_loop", measured, peers)


def batch_rows(rounds: int = 5) -> list[Row]:
    """64 closed-loop runs on one core, all metrics, signals off; seconds are those of one run."""
    batch = make_batch()
    cases = ours.loop_cases(batch)
    rolled = casadi_sim.make_loop(batch[0], 5)
    truth = {j: solve_loop(batch[j])[0] for j in BATCH_JUDGED}
    some = [batch[j] for j in BATCH_JUDGED] * (CASADI_BATCH // len(BATCH_JUDGED))

    def own_error(_: object) -> float:
        shown = ours.closed_loops(cases, 10)  # the same kernel lanes as in the timed call, signals kept
        return max(speed_error(ours.speed_of(shown[j]), truth[j][::10]) for j in BATCH_JUDGED)

    def casadi_error(speeds: list[Floats]) -> float:
        return max(speed_error(s, truth[j]) for s, j in zip(speeds, BATCH_JUDGED, strict=False))

    measured = in_turns(
        {
            OURS: Work(lambda: ours.closed_loops(cases, 0), own_error, parts=len(cases)),
            "casadi": Work(lambda: casadi_sim.closed_loops(rolled, some), casadi_error, parts=len(some)),
        },
        rounds,
    )
    return _rows("batch", measured, {"casadi": ("RK4, 5 steps a sample, mapaccum mapped over 8 runs, serial", None)})


def fit_rows(rounds: int = 3) -> list[Row]:
    """Both friction levels and the slope from one log; the error is the worst parameter's, relative."""
    log = make_fit_log()
    bench = ours.read(log)
    true = np.array(list(FITTED.values()))
    nominal = load_hoist(PAYLOAD_KG)

    def error(fitted: Floats) -> float:
        return float(np.max(np.abs(fitted / true - 1.0)))

    measured = in_turns(
        {
            OURS: Work(lambda: np.array(ours.friction_fit(bench).value), error, quick=True),
            "scipy-lsoda": Work(lambda: scipy_ivp.friction_fit(log, nominal, 1e-11, 1e-5, 1e-2, 1e-4), error),
        },
        rounds,
    )
    return _rows("fit", measured, {"scipy-lsoda": ("least_squares, atol 1e-5, difference step 1 %, xtol 1e-4", 300.0)})


def all_rows() -> list[Row]:
    case = make_loop()
    speed, torque = solve_loop(case)
    return [*replay_rows(torque), *model_rows(torque), *loop_rows(case, speed), *batch_rows(), *fit_rows()]


def table(rows: Sequence[Row]) -> Table:
    lines = []
    for row in rows:
        limit = FIT_ACCURACY if row.name == "fit" else ACCURACY
        target = "" if row.target is None else f"{row.target:.0f} {'met' if row.ratio >= row.target else 'missed'}"
        both = (row.ours, row.theirs)
        times = [f"{m.seconds:.2f} s" if m.seconds >= 1.0 else f"{m.seconds * 1e3:.3g} ms" for m in both]
        errors = [f"{m.error:.1e}{'' if m.error <= limit else ' !'}" for m in both]
        lines.append([row.name, row.peer, *times, f"{row.ratio:.3g}", target, *errors])
    heads = ("workbench", "peer's time", "ratio", "target", "error", "peer's error")
    note = "49.76 s of motion; medians of CPU time, interleaved warm runs, one thread."
    return Table([words("name"), words("peer"), *map(Column, heads)], lines, note)


def main() -> None:
    console = Console()
    if not console.is_terminal:
        console = Console(width=120)
    begin = time.perf_counter()
    rows = all_rows()
    RESULTS.write_text(json.dumps([row.record() for row in rows], indent=1) + "\n", encoding="utf-8")
    shown = table(rows)
    console.print(shown, shown.note, sep="\n")
    for row in rows:
        console.print(f"  {row.name:12s} {row.peer:15s} {row.setting}", highlight=False)
    batch = next(row for row in rows if row.name == "batch")
    rate = 1.0 / batch.ours.seconds
    verdict = "met" if rate >= BATCH_PER_SECOND else "missed"
    console.print(f"batch: {rate:.0f} runs a second and core, target {BATCH_PER_SECOND:.0f}, {verdict}")
    console.print(
        f"errors: motor speed against Runge-Kutta at 5 microseconds over its largest value, at most {ACCURACY:g}; "
        f"fit: worst parameter, at most {FIT_ACCURACY:g}; ! marks what is above"
    )
    waited = max(m.clock_seconds / m.seconds for row in rows for m in (row.ours, row.theirs))
    if waited > BUSY:
        console.print(
            f"the machine was busy: by the clock something took {waited:.2f} times its CPU time. "
            "Ratios are those of CPU time; even they are surer on a quiet machine"
        )
    console.print(f"{time.perf_counter() - begin:.0f} s; wrote {RESULTS}")


if __name__ == "__main__":
    main()
