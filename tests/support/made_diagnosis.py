"""Diagnoses made by hand from simulated runs: what reports show, without the search behind it."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np

from tests.support.log_campaign import csv_text
from tests.support.simulated_campaign import simulated_campaign
from workbench.core.run import Array
from workbench.diagnose.diagnose import Diagnosis
from workbench.diagnose.gap import Gap, Shrink, delivered_of
from workbench.diagnose.hypotheses.free_parameters import Estimate
from workbench.diagnose.isolability import Isolability
from workbench.diagnose.isolation.next_run import NextRun
from workbench.diagnose.location.profiles import Profile
from workbench.diagnose.location.where import Where, Window
from workbench.diagnose.readiness.condition import Condition, RunCondition
from workbench.diagnose.tables import Curve
from workbench.diagnose.unknown import Unknown
from workbench.diagnose.verdict.answer import Candidate, Hypothesis, Reason, ReasonKind, Verdict
from workbench.effects import effects_for
from workbench.logs import Campaign, read_campaign
from workbench.machines import Axis, Hoist, default_hoist, kind_of, plant_of, with_correction
from workbench.simulate.driven import Balance, InverseSimulation, pooled_rms
from workbench.simulate.replay import replay_runs
from workbench.study.consequences import consequences_of

Values = Mapping[str, Mapping[str, float]]
VISCOUS: Values = {"friction_viscous": {"viscous_n_s_per_m": 4210.0}}
PAIR: Values = {**VISCOUS, "gearbox_inertia": {"inertia_kg_m2": 0.31}}
COULOMB: Values = {"friction_coulomb": {"level_n": 18.0}}
STEP: Values = {"friction_step": {"level_n": 3000.0, "position_m": 9.6, "width_m": 0.2}}
KINDS = ("named", "pair", "no_gap", "unknown", "axis")
AXIS = """\
kind: axis
motion: linear
name: test axis
mass_kg: 95.0
gravity: {constant_n: 0.0}
friction: {coulomb_forward_n: 2.0, coulomb_backward_n: 2.0, viscous_n_s_per_m: 200.0}
"""


REASONS = (
    Reason(ReasonKind.UNLISTED_EXPLAINS_MORE, ("friction_step",)),
    Reason(ReasonKind.LEAVES_MUCH, value=3.6, percent=0.8),
    Reason(ReasonKind.FREE_LAW, ("friction_coulomb",), over="height of the carriage"),
)
CLOSE = (Reason(ReasonKind.ON_A_BOUND, ("heave",)),)


@cache
def made_diagnosis(kind: str, with_consequences: bool = False) -> Diagnosis:
    """One of KINDS. Runs and residuals are simulated; probabilities, angles and the like are invented."""
    effects = {"named": VISCOUS, "pair": PAIR, "axis": COULOMB}.get(kind, {})
    truth: Values = STEP if kind == "unknown" else effects
    campaign = _axis_campaign() if kind == "axis" else _hoist_campaign(truth)
    nominal = campaign.machine
    corrected = nominal.model_copy(update={"effects": dict(effects)})
    curve = _curve() if kind == "unknown" else None
    if curve is not None:
        corrected = with_correction(nominal, curve.over, curve.acts_on, curve.at, curve.forward, curve.backward)
    before, after = (InverseSimulation(machine, campaign.runs).balances() for machine in (nominal, corrected))
    gap, shrink = _gap(campaign, before, after, kind), _shrink(campaign, before, after, corrected)
    consequences, why = None, "not asked for"
    if with_consequences:
        consequences, why = consequences_of(nominal, corrected, runs=campaign.runs)
    return Diagnosis(
        campaign=campaign,
        seed=0,
        condition=_condition(campaign, before),
        gap=gap,
        delivered=delivered_of(
            np.full(len(campaign.runs), 0.5), replay_runs(nominal, campaign.runs), replay_runs(corrected, campaign.runs)
        ),
        where=None if kind == "no_gap" else _where(campaign, before, kind),
        candidates=_candidates(nominal, effects, gap),
        isolability=_isolability(nominal),
        verdict=_verdict(kind, tuple(effects)),
        next_run=_next_run(kind),
        shrink=shrink,
        corrected=corrected,
        refitted=nominal,
        unknown=None if curve is None else Unknown((curve,), ("The height explains it best.",)),
        consequences=consequences,
        why_no_consequences=why,
        search=cast(Any, None),
        judged=cast(Any, None),
        warnings=("No run logs the dead line's tension.",) if kind == "pair" else (),
    )


def _hoist_campaign(truth: Values) -> Campaign:
    machine = default_hoist().model_copy(update={"effects": dict(truth)})
    with tempfile.TemporaryDirectory() as folder:
        return read_campaign(simulated_campaign(Path(folder) / "lifts", machine))


def _axis_campaign() -> Campaign:
    """Two runs of a linear axis with 20 N of Coulomb friction where the machine knows 2 N."""
    noise = np.random.default_rng(11)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "bench"
        (folder / "runs").mkdir(parents=True)
        (folder / "machine.yaml").write_text(AXIS)
        entries = []
        for name, rate in (("slow", 1.0), ("fast", 2.5)):
            time = np.arange(0.0, 12.0, 0.005)
            position = 0.1 * np.cos(rate * time)
            speed, acceleration = np.gradient(position, time), -(rate**2) * position
            force = 95.0 * acceleration + 200.0 * speed + 20.0 * np.tanh(speed / 1e-4)
            columns = {"time_s": time, "force_n": force + noise.normal(scale=3.0, size=len(time))}
            columns |= {"position_m": position, "velocity_m_s": speed}
            (folder / "runs" / f"{name}.csv").write_text(csv_text(columns))
            entries.append(f"- {{name: {name}, file: runs/{name}.csv, start_time_s: 0.0}}\n")
        (folder / "runs.yaml").write_text("runs:\n" + "".join(entries))
        return read_campaign(folder)


def _condition(campaign: Campaign, balances: list[Balance]) -> Condition:
    runs = tuple(
        RunCondition(
            run.name, len(run.time_s), run.sample_time_s, b.noise_rms, float(np.mean(b.moving)), 0.0, 2, None,
            ("2 single samples far off were left out",),
        )
        for run, b in zip(campaign.runs, balances, strict=True)
    )  # fmt: skip
    return Condition(runs, balances[0].band_hz, balances[0].noise_rms, ("Nothing is clipped.",))


def _rms(balances: list[Balance]) -> float:
    return pooled_rms([b.residual[b.moving] for b in balances])


def _gap(campaign: Campaign, before: list[Balance], after: list[Balance], kind: str) -> Gap:
    machine, rms, noise = campaign.machine, _rms(before), _rms(after) * 0.95
    lift = machine.lift_m_per_rad if isinstance(machine, Hoist) else None
    speed = replay_runs(machine, campaign.runs).speed_rmse_percent
    return Gap(
        rms, noise, before[0].band_hz, None if lift is None else rms / lift, speed, 1.1 * rms, 1.2 * speed,
        ("guide.coulomb_hoisting_n", 1.7) if lift else ("inertia", 0.4), kind != "no_gap",
        (f"The residual is {rms / noise:.1f} times the noise.",),
    )  # fmt: skip


def _where(campaign: Campaign, balances: list[Balance], kind: str) -> Where:
    windows = tuple(Window(b.run.name, float(b.run.time_s[-1]) * 0.3, float(b.run.time_s[-1]) * 0.45) for b in balances)
    place = {"unknown": ("guide", "position"), "axis": ("axis", "all")}.get(kind, ("guide", "speed"))
    profiles = [_profile(balances, "speed", "speed", "m/s", "speed", -1)]
    if isinstance(campaign.machine, Hoist):
        profiles.append(_profile(balances, "position", "carriage height", "m", "position", 1))
    profiles.append(_profile(balances, "time", "time since the start", "s", "start", None))
    return Where(
        *place, windows, 0.81, 0.15, (0.76, 0.85), tuple(profiles),
        "carriage" if kind in ("named", "pair") else "unsaid", ("It grows with the speed, alike both ways.",),
    )  # fmt: skip


def _profile(balances: list[Balance], name: str, label: str, unit: str, regime: str, state: int | None) -> Profile:
    """state: the column of the states it is over; None: time."""
    x = np.concatenate([_variable(b, state)[b.moving] for b in balances])
    r = np.concatenate([b.residual[b.moving] for b in balances])
    ahead = np.concatenate([b.motion.speed[b.moving] for b in balances]) > 0.0
    edges = np.linspace(x.min(), x.max(), 11)
    bins = np.clip(np.digitize(x, edges) - 1, 0, 9)
    means = [
        np.array([r[way & (bins == k)].mean() if np.any(way & (bins == k)) else np.nan for k in range(10)])
        for way in (ahead, ~ahead)
    ]
    share = np.array([np.sum(r[bins == k] ** 2) for k in range(10)]) / np.sum(r**2)
    return Profile(name, label, unit, regime, edges, means[0], means[1], share, 0.74, (0.68, 0.8))


def _variable(balance: Balance, state: int | None) -> Array:
    if state is None:
        return balance.run.time_s
    return balance.states[:, state] if balance.states.size else balance.motion.speed


def _candidates(machine: Hoist | Axis, effects: Values, gap: Gap) -> tuple[Candidate, ...]:
    kind = plant_of(machine).kind
    named = []
    if effects:
        said = {
            name: tuple(Estimate(key, value, 0.03 * abs(value)) for key, value in values.items())
            for name, values in effects.items()
        }
        named.append(Candidate(tuple(effects), 812.4, 790.1, gap.noise_rms, 1.04 * gap.noise_rms, 0.994, said, True))
    wave = {"heave": (Estimate("phase_rad", (0.1, 2.2, 1.4), (0.2, 0.2, float("inf"))),)}
    rows: list[Candidate] = []
    if kind == "hoist":
        rows.append(
            Candidate(
                ("heave",), 31.0, 9.0, 0.9 * gap.residual_rms, 1.2 * gap.residual_rms, 0.11, wave, True,
                ("held-out runs get worse", "sits on the bound of frequency_rad_s"),
            )
        )  # fmt: skip
    rows += [
        Candidate(("friction_stribeck",), 12.0, -3.0, None, None, 0.05, {}, False),
        Candidate(("backlash",), 0.0, 0.0, None, None, None, {}, False, (), "ValueError: the step size fell to zero"),
    ]
    return (*named, *rows)


def _isolability(machine: Hoist | Axis) -> Isolability:
    names = tuple(name for name, effect in effects_for(plant_of(machine).kind).items() if effect.listed)
    spread = np.random.default_rng(5).uniform(0.0, 2.6, (len(names), 3))
    away = np.linalg.norm(spread[:, None] - spread[None, :], axis=2)
    angle = np.clip(90.0 * away / away.max() * 1.4, 0.0, 90.0)
    visible = dict.fromkeys(names[:6], ("level_n", 120.0))
    return Isolability(names, angle, visible, (f"{names[0]} and {names[1]} leave the same mark here.",))


def _verdict(kind: str, effects: tuple[str, ...]) -> Verdict:
    ranking: tuple[Hypothesis, ...]
    unknown, no_gap = Hypothesis("unknown", (), 0.041), Hypothesis("no_gap", (), 0.0251)
    if kind == "no_gap":
        ranking = (Hypothesis("no_gap", (), 0.97), Hypothesis("named", ("friction_viscous",), 0.02), unknown)
        return Verdict("no_gap", (), ranking, (), "No gap: what is left is noise.")
    if kind == "unknown":
        ranking = (Hypothesis("unknown", (), 0.88), Hypothesis("named", ("friction_position_dependent",), 0.12), no_gap)
        return Verdict("unknown", (), ranking, (), "A gap without a known cause.", REASONS)
    ranking = (Hypothesis("named", effects, 0.93), unknown, no_gap, Hypothesis("named", ("friction_stribeck",), 1e-7))
    alike = ("carriage_mass_error",) if kind == "pair" else ()
    return Verdict("named", effects, ranking, alike, f"The machine lacks {' and '.join(effects)}.", CLOSE)


def _next_run(kind: str) -> NextRun | None:
    if kind != "pair":
        return None
    why = "A slow run tells friction_viscous from carriage_mass_error."
    return NextRun(why, 9000.0, "half speed, two reversals", ("tension_dead_line_n",), 7.4, 1.3)


def _shrink(campaign: Campaign, before: list[Balance], after: list[Balance], corrected: Hoist | Axis) -> Shrink:
    was, is_now = _rms(before), _rms(after)
    speeds = [replay_runs(machine, campaign.runs).speed_rmse_percent for machine in (campaign.machine, corrected)]
    by_run = {b.run.name: (_rms([b]), _rms([a])) for b, a in zip(before, after, strict=True)}
    factor = was / is_now
    return Shrink(
        was, is_now, 0.95 * is_now, kind_of(corrected).drive.unit, before[0].band_hz,
        factor, (0.9 * factor, 1.1 * factor), speeds[0], speeds[1], by_run, ("Each run was held out once.",),
    )  # fmt: skip


def _curve() -> Curve:
    at = np.linspace(8.5, 11.0, 11)
    step = 3000.0 * np.clip((at - 9.6) / 0.2 + 0.5, 0.0, 1.0)
    error = np.full(11, 90.0)
    return Curve("position_carriage_m", "guide", at, step, step, error, 1.3 * error, 0.83)
