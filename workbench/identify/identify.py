"""Identification of a campaign's machine: friction levels by iteration, then all free values in one fit."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np

from workbench import __version__
from workbench.core.errors import InputError
from workbench.core.run import Array, Run
from workbench.core.shown import Shown
from workbench.effects import find, of, ranges_of
from workbench.identify.fit import Fit, fit
from workbench.identify.model import BalanceModel, Free, free_parameters
from workbench.logs import Campaign
from workbench.machines import Axis, Hoist, Kind, kind_of, with_values
from workbench.simulate.driven import Balance, InverseSimulation, changed, sensor
from workbench.simulate.lowpass import check_band, lowpass
from workbench.simulate.noise import usable_band
from workbench.simulate.replay import ReplayResult, own_log, replay_runs

MOST_ROUNDS = 30
SETTLED = 1e-4  # of the level
LATE = "log.speed_late_s"  # fitted before the other values: friction jumps over it
LATE_SCALE = 50.0  # periods of the band: a step for derivatives is a twentieth of one, for friction jumps over less
SURE = 3.0  # standard errors
FEW = 0.01  # of the moving samples: fewer the other way show no level of it
HALF = 0.5  # of the input's rms: where more is left, the equation is not this machine's, and tells nothing of its log


@dataclass(frozen=True)
class Levels:
    """The two levels' history and the profile they come from.

    forward, backward: (rounds + 1,) N (N m), the start first; hoisting is forward.
    speed, force: the friction profile of the last round at moving samples, carriage or axis side.
    """

    forward: tuple[float, ...]
    backward: tuple[float, ...]
    settled: bool
    speed: Array
    force: Array


def friction_levels(bench: InverseSimulation) -> Levels:
    """Solve Eq. 16 for the friction force under the measured torque, then Eq. 17 for both levels; iterate.

    In each round the carriage moves as the measured speed and the levels so far make it
    move; the balance of torque, carried over to the carriage, corrects the friction
    profile; each level is the median ratio of the profile to its switching function over
    the moving samples of its direction.
    """
    forward_symbol, backward_symbol = kind_of(bench.machine).friction.levels
    values = list(bench.base)
    forward = [float(getattr(values[0], forward_symbol))]
    backward = [float(getattr(values[0], backward_symbol))]
    settled = False
    speed = force = np.zeros(0)
    for _ in range(MOST_ROUNDS):
        speed, force, switch = _profile(bench, bench.balances(values), values)
        up, down = speed > 0.0, speed < 0.0
        forward.append(_level(force[up], switch[up], forward[-1]))
        backward.append(_level(force[down], switch[down], backward[-1]))
        values = [changed(p, {forward_symbol: forward[-1], backward_symbol: backward[-1]}) for p in values]
        settled = all(abs(x[-1] - x[-2]) <= SETTLED * max(abs(x[-1]), 1e-9) for x in (forward, backward))
        if settled:
            break
    return Levels(tuple(forward), tuple(backward), settled, speed, force)


def _level(force: Array, switch: Array, before: float) -> float:
    return max(float(np.median(force / switch)), 0.0) if len(force) else before


def _profile(bench: InverseSimulation, balances: list[Balance], values: list[SimpleNamespace]) -> Array:
    """(3, n): speed, Coulomb friction force and switching function at the moving samples of all runs."""
    gain, _ = sensor(bench.machine)
    kind = kind_of(bench.machine)
    parts = []
    for b, p in zip(balances, values, strict=True):
        speed, switch, coulomb = _friction(kind, b, p)
        smooth = lowpass(b.run.time_s, np.column_stack([speed, switch, coulomb]), b.band_hz)[b.moving]
        force = smooth[:, 2] + b.residual[b.moving] / gain / kind.transmission_of(bench.machine)
        keep = np.abs(smooth[:, 1]) > 0.5
        parts.append(np.column_stack([smooth[:, 0], force, smooth[:, 1]])[keep])
    return np.concatenate(parts).T


def _friction(kind: Kind, b: Balance, p: SimpleNamespace) -> tuple[Array, Array, Array]:
    """Speed at the friction, its switching function and its Coulomb force, as simulated."""
    law, v = kind.friction, friction_speed(kind, b)
    unit = changed(p, {**dict.fromkeys(law.levels, 1.0), **law.off})
    return v, law.law(v, unit), law.law(v, changed(p, law.off))


def friction_speed(kind: Kind, b: Balance) -> Array:
    """Speed at which friction acts, (n,): measured if it is the driven speed, else simulated."""
    others = (*kind.plant.positions[1:], *kind.plant.speeds[1:])
    if kind.friction.speed in others:
        return b.states[:, others.index(kind.friction.speed)]
    return b.motion.speed


@dataclass(frozen=True, repr=False)
class Identification(Shown):
    """An identification: the machine, the fit, the paper's iteration, and replays before and after."""

    campaign: Campaign
    machine: Hoist | Axis
    fit: Fit
    levels: Levels
    before: ReplayResult
    after: ReplayResult


def identify(
    campaign: Campaign, *, free: Sequence[str] | None = None, band_hz: float | None = None, date: str = ""
) -> Identification:
    """Fit the campaign's machine to its runs; `free` are keys of machine.yaml, None for the kind's default.

    band_hz: None for the kind's, and on an axis as far up as its motion outweighs its noise (`simulate/noise.py`).
    date: when, for the record; the caller's clock. Without it the same runs give the same record.
    """
    machine = campaign.machine
    bench = InverseSimulation(machine, campaign.runs, band_hz)
    if band_hz is None and (band := usable_band(bench)) < bench.band_hz:
        bench = InverseSimulation(machine, campaign.runs, band)
    check_band(bench.band_hz, campaign.runs)
    others = free and [key for key in free if key != LATE]
    parameters = free_parameters(machine, campaign.runs, others)
    late = late_s(bench, parameters) if free is None or LATE in free else machine.log.speed_late_s
    if late != machine.log.speed_late_s:
        machine = machine.model_copy(update={"log": machine.log.model_copy(update={"speed_late_s": late})})
        bench = InverseSimulation(machine, campaign.runs, bench.band_hz)
    levels = friction_levels(bench)
    # Pairs are kept equal, because the runs show only two sums of the three.
    tied = [(pair, third) for pair, third in kind_of(machine).ties if {*pair, third} <= {f.key for f in parameters}]
    ties = [pair for pair, _ in tied]
    forward = np.mean(levels.speed > 0.0) if len(levels.speed) else 0.5
    one_way = [] if FEW < forward < 1.0 - FEW else [third for _, third in tied]
    parameters = [f for f in parameters if f.key not in one_way]
    model = BalanceModel(bench)

    def own(z: Array) -> Array:
        """Residuals of the fitted model on its own log: the motion that the measured input gives it, sampled."""
        values = {f.key: f.value(float(x)) for f, x in zip(parameters, z, strict=True)}
        return model.on(own_log(with_values(machine, values), campaign.runs)).residuals(parameters, [z])[0]

    try:
        alike, weighed = fit(model, parameters, ties, own), fit(model, parameters, ties, own, model.spread)
    except (np.linalg.LinAlgError, ZeroDivisionError, OverflowError) as error:
        problem = "the fit breaks down, its numbers are not finite; is a value of machine.yaml in another unit?"
        raise InputError(problem, file=campaign.path) from error
    values = zip(parameters, alike.value, weighed.value, weighed.std_error, strict=True)
    bent = [f"{f.key} {a:.4g}" for f, a, w, std in values if abs(a - w) > SURE * std]
    result = weighed if bent else alike
    told = [f"{key} stays as it is: in motion one way it is one sum with the friction level" for key in one_way]
    told += result.statements
    if bent:
        told += [
            "friction near standstill is not as its law: samples there weigh less; alike they would make "
            + ", ".join(bent)
        ]
    percent = 100.0 * result.residual_rms / _input_rms(model)
    if percent > 100.0 * HALF:
        told.append(
            f"while moving, {percent:.0f} % of the {kind_of(machine).drive.quantity} itself is left: the balance does "
            "not hold, its values mean little; is a sign, a unit, a column or the kind of machine another one?"
        )
    if late > 0.0:
        told.append(f"{LATE}: the logged motion is {1e3 * late:.3g} ms later than the logged input")
    result = replace(result, statements=tuple(told))
    identified = with_values(machine, result.values())
    identified = identified.model_copy(update={"identified": record(campaign, result, levels, bench.band_hz, date)})
    return Identification(
        campaign,
        identified,
        result,
        levels,
        replay_runs(campaign.machine, campaign.runs, bench.band_hz),
        replay_runs(identified, campaign.runs, bench.band_hz),
    )


def late_s(bench: InverseSimulation, parameters: Sequence[Free]) -> float:
    """By how much the logged motion is later than the logged input, s, by least squares beside `parameters`; as it is
    known where that may be off by chance, or is by less than a sampling step: within one, two channels are sampled.
    Also where it is more than a log ever is, or serves a balance that does not hold: a motion that comes again fits
    one a period later."""
    machine, runs = bench.machine, bench.runs
    (delay,) = ranges_of(find("speed_delay", bench.plant.kind), machine, runs)
    log = machine.log.speed_late_s
    known = log + machine.effects.get("speed_delay", {}).get(delay.name, 0.0)
    active = of(machine, {"speed_delay": {delay.name: known}})
    model = BalanceModel(InverseSimulation(machine, runs, bench.band_hz, active))
    free = [*parameters, Free(LATE, delay.symbol, known, LATE_SCALE / bench.band_hz, False, known - log, None)]
    if sum(model.run_lengths) <= len(free):
        return log
    found = fit(model, free, spread=model.spread)
    off = found.value[-1] - known
    sure = abs(off) > max(SURE * found.std_error[-1], *(run.sample_time_s for run in runs))
    holds = found.residual_rms < HALF * _input_rms(model) and known + off <= delay.highest
    serves = sure and holds and found.unlikely < fit(model, parameters, spread=model.spread).unlikely
    return log + off if serves else log


def _input_rms(model: BalanceModel) -> float:
    """Of the measured input at the samples that a fit looks at, in its unit."""
    chosen = [measured[rows] for measured, rows in zip(model.bench.measured, model.rows, strict=True)]
    return float(np.sqrt(np.mean(np.concatenate(chosen) ** 2)))


def _digest(runs: Sequence[Run]) -> str:
    """SHA-256 of the samples that the fit has seen, as they were read and repaired."""
    digest = hashlib.sha256()
    for run in runs:
        for name, column in (("time_s", run.time_s), *sorted(run.signals.items())):
            digest.update(f"{run.name}\0{name}\0{len(column)}\0".encode() + np.ascontiguousarray(column).tobytes())
    return digest.hexdigest()


def record(campaign: Campaign, result: Fit, levels: Levels, band_hz: float, date: str) -> dict[str, object]:
    """The record of the identification that goes into the machine's file."""
    return {
        "campaign": campaign.name,
        "runs": [run.name for run in campaign.runs],
        **({"date": date} if date else {}),
        "data_sha256": _digest(campaign.runs),
        "version": __version__,
        "method": "joint least squares on the band-limited torque balance, tolerances as priors",
        "band_hz": float(f"{band_hz:.6g}"),
        "residual_rms": float(f"{result.residual_rms:.6g}"),
        "noise_rms": float(f"{result.noise_rms:.6g}"),
        "parameters": {
            f.key: {
                "value": float(f"{value:.8g}"),
                "std_error": float(f"{error:.4g}"),
                "nominal": f.nominal,
                "held_by_tolerance": f.prior_std is not None,
            }
            for f, value, error in zip(result.free, result.value, result.std_error, strict=True)
        },
        "paper_iteration": {
            "forward": float(f"{levels.forward[-1]:.8g}"),
            "backward": float(f"{levels.backward[-1]:.8g}"),
            "rounds": len(levels.forward) - 1,
            "settled": levels.settled,
        },
        "statements": list(result.statements),
    }
