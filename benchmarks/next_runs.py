"""`python -m benchmarks.next_runs FOLDER --seed 9811`: whether the recommended run settles what a campaign leaves open.

Short campaigns of one listed cause are drawn. Where the diagnosis leaves the true cause and another one open and states
that a run decides, with a probability from ASKED on, that run is simulated on the same true machine and the campaign is
diagnosed with it, and again with the best plain run of the menu that takes no longer in its place, or the shortest one.
Settled: the true cause alone, nothing open.

Few campaigns ask a question. `--runs 1 --profiles slow middle --effects torque_offset carriage_mass_error
payload_mass_error torque_scale gearbox_efficiency inertia_error friction_coulomb friction_load_dependent
friction_viscous` makes one of two ask.

With `--draws N` both runs are also simulated N times under each open hypothesis, whatever probability is stated: the
machine drawn from what its fit leaves open, with the noise of the logs and the model error that it leaves; the open
hypotheses are refitted to the campaign with that run and judged as a diagnosis judges them.
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.validation.campaign import make_campaign
from benchmarks.validation.content import Content, kind_of
from benchmarks.validation.entry import content_of
from benchmarks.validation.families import FAMILIES
from benchmarks.validation.next_run import extended
from workbench.blind.make import mapped
from workbench.blind.run import save
from workbench.blind.seal import Order
from workbench.core.errors import InputError
from workbench.core.run import Array, Run
from workbench.diagnose.diagnose import Diagnosis, diagnose, open_hypotheses
from workbench.diagnose.hypotheses.evidence import price, score_of
from workbench.diagnose.hypotheses.fit import Fitted, covariance, fit_hypothesis
from workbench.diagnose.hypotheses.free_parameters import (
    GAIN,
    LOAD_CELL_STD,
    OFFSET,
    TENSION_GAIN,
    FreeParameter,
    PhaseOfEachRun,
    base_parameters,
    bounds_of,
    setting_of,
)
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.search import SearchResult
from workbench.diagnose.isolation.lines import on_campaign
from workbench.diagnose.isolation.next_run import APART, SURE, compared, distances
from workbench.diagnose.isolation.planned import Planned
from workbench.diagnose.readiness.checks import variety
from workbench.diagnose.readiness.noise import with_motion_noise
from workbench.diagnose.verdict.judge import Judged, alternatives, judged_to_help, runners_up
from workbench.logs import read_campaign
from workbench.machines import kind_of as machine_kind
from workbench.simulate.model_error import carries, model_error_of
from workbench.simulate.noise import channel_noise

BINS = (0.0, 0.1, 0.5, 0.9, 1.01)  # of the stated probability
CELL = 0.001  # of the mean tension: a load cell's noise, where the campaign has none
ASKED = 0.5  # probability to decide, as stated, from which on a run is simulated
Kept = Callable[[np.random.Generator, Content], Content]
FAMILY = ("hoist_practice", "axis_std", "hoist_small", "axis_rates", "hoist_middle", "axis_encoder")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--cases", type=int, default=20, help="campaigns that are drawn")
    parser.add_argument("--runs", type=int, default=2, help="of each campaign")
    parser.add_argument("--families", nargs="+", default=FAMILY)
    parser.add_argument("--effects", nargs="+", default=(), help="causes that are drawn; without, all usual ones")
    parser.add_argument("--profiles", nargs="+", default=(), help="of the runs that are kept, as slow; without, all")
    parser.add_argument("--one-payload", action="store_true", help="runs of one payload alone are kept")
    parser.add_argument("--draws", type=int, default=0, help="runs simulated under each open hypothesis")
    parser.add_argument("--processes", type=int, default=1)
    given = parser.parse_args()
    orders = [drawn(given.seed, n, given.families[n % len(given.families)], given.effects) for n in range(given.cases)]
    kept = partial(few, given.runs, given.profiles, given.one_payload)
    with mapped(given.processes) as over:
        for line in over(partial(asked, given.folder, kept, given.draws), orders):
            print(line, flush=True)
    rows = [json.loads(file.read_text(encoding="utf-8")) for file in sorted(given.folder.glob("*.json"))]
    for line in calibration(rows):
        print(line)
    for least in (SURE, ASKED):
        questions = [row for row in rows if "designed" in row and row["decides"] >= least]
        stated = np.mean([row["decides"] for row in questions] or [np.nan])
        print(f"probability stated {least:g} and more, {stated:.2f} on the mean")
        for run in ("designed", "plain"):
            ends = [row[run] for row in questions]
            print(
                f"{run}: {sum(end['settled'] for end in ends)} of {len(ends)} questions settled, "
                f"{sum(end['right'] for end in ends)} named right; separation "
                f"{np.median([end['separation'] for end in ends] or [np.nan]):.1f} at the median; "
                f"{np.mean([end['lasts_s'] for end in ends] or [np.nan]):.0f} s on the mean"
            )


def drawn(seed: int, number: int, family: str, effects: Sequence[str] = ()) -> Order:
    rng, usual = np.random.default_rng([seed, number, 8]), kind_of(FAMILIES[family]).usual
    name = str(rng.choice([name for name in usual if name in effects] or usual))
    return Order(number, (seed, number), "simulator", family, "singles", (name,))


def few(many: int, profiles: Sequence[str], one_payload: bool, rng: np.random.Generator, content: Content) -> Content:
    """A campaign with so many of its runs, drawn: of these profiles, where it has them, and of one payload."""
    runs = [run for run in content.runs if run.profile in profiles] or content.runs
    if one_payload:
        load = rng.choice([run.payload_kg for run in runs])
        runs = [run for run in runs if run.payload_kg == load]
    which = sorted(rng.choice(len(runs), min(many, len(runs)), replace=False))
    return replace(content, runs=tuple(runs[k] for k in which))


def calibration(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Of simulated runs: the stated probability against the share that is settled, and designed against plain."""
    known = [(row["decides"], *(_settled(row, row["simulated"][run]) for run in ("designed", "plain")))
             for row in rows if "simulated" in row]  # fmt: skip
    lines = []
    for low, high in pairwise(BINS):
        of_bin = np.array([one for one in known if low <= one[0] < high])
        if len(of_bin):
            stated, designed, plain = np.mean(of_bin, axis=0)
            lines.append(
                f"stated {low:g} to {min(high, 1.0):g}: {len(of_bin)} questions, stated {stated:.2f}, settled "
                f"{designed:.2f}, by the plain run of the same length {plain:.2f}"
            )
    return lines


def _settled(row: Mapping[str, Any], ends: Sequence[Mapping[str, Any]]) -> float:
    """The share of runs that leave the true hypothesis alone, each hypothesis as likely as the campaign has it."""
    of_each = [[end["end"] == "right" for end in ends if end["true"] == k] for k in range(len(row["likely"]))]
    return float(np.dot(row["likely"], [np.mean(one) for one in of_each]))


def asked(folder: Path, kept: Kept, draws: int, order: Order) -> str:
    """One campaign, a line of what came of it; what is there is kept."""
    file = folder / f"{order.number:03d}.json"
    if not file.exists():
        save(json.dumps(_asked(file.with_suffix(""), kept, draws, order), default=float), file)
    row = json.loads(file.read_text(encoding="utf-8"))
    ends = "; ".join(f"{k}: {'+'.join(row[k]['named'])} {'settled' if row[k]['settled'] else row[k]['open']}"
                     for k in ("designed", "plain") if k in row)  # fmt: skip
    return f"{file.stem} {order.family} {row['true']}: {row['said']}. {ends}"


def _asked(folder: Path, kept: Kept, draws: int, order: Order) -> dict[str, Any]:
    content, (true,) = kept(np.random.default_rng([*order.seed, 9]), content_of(order)), order.names
    try:
        first = _diagnosed(folder / "before", order, content)
    except InputError as refused:  # as a run that stands still
        return {"family": order.family, "true": true, "said": str(refused)}
    more, said = first.next_run, first.verdict.sentence
    row: dict[str, Any] = {"family": order.family, "true": true, "said": said}
    if more is None:
        return row
    row |= {"now": more.now, "decides": more.decides, "why": more.why}
    if draws and (asks := open_fits(first)):
        weighed = {w.names: w.evidence for w in first.judged.weighed}
        worth = np.array(
            [weighed.get(tuple(sorted(fit.effects)), price(first.search.problem.active.kind)) for fit in asks]
        )
        likely = np.exp(0.5 * (worth - np.max(worth)))
        row |= {"likely": list(likely / np.sum(likely)), "asked": [fit.effects for fit in asks], "simulated": {
            name: [end for k in range(len(asks)) for n in range(draws)
                   for end in [simulated(first.search, asks, k, run, more.signals, (*order.seed, k, n))]]
            for name, run in (("designed", more.planned), ("plain", more.plain)) if run is not None
        }}  # fmt: skip
    known = (true,) in (first.verdict.effects, *more.rivals)
    if more.decides < ASKED or more.plain is None or more.planned is None or not known:
        return row  # no run decides, or the true cause is not among those that are open
    plain = more.plain.motion | {"payload_kg": more.plain.payload_kg, "signals": more.signals}
    plain_s, designed_s = more.plain.duration_s, more.planned.duration_s
    both = (("designed", more.record, more.separation, designed_s), ("plain", plain, more.menu, plain_s))
    for name, run, apart, lasts in both:
        end = _with(folder / name, order, content, run, folder / "before", true)
        row[name] = end | {"separation": apart, "lasts_s": lasts}
    return row


def open_fits(d: Diagnosis) -> list[Fitted]:
    """Of the hypotheses that a diagnosis leaves open: the answer and its rivals; none where the answer is unknown."""
    if d.next_run is None or d.verdict.word == "unknown":
        return []
    fits = {names: d.search.fits.get(tuple(sorted(names))) for names in (d.verdict.effects, *d.next_run.rivals)}
    return [fit for names, fit in (fits | ({(): d.search.base} if () in fits else {})).items() if fit is not None]


def simulated(
    search: SearchResult, fits: Sequence[Fitted], true: int, run: Planned, signals: Sequence[str], seed: Sequence[int]
) -> dict[str, Any]:
    """What the campaign says with a run of a machine that one of the open hypotheses holds of. end: right, where it is
    left alone (an unlisted one: where the cause is unknown), wrong, where another one is, open."""
    new, judged = rejudged(search, fits, driven(search.problem, fits[true], run, signals, np.random.default_rng(seed)))
    names = tuple(sorted(fits[true].effects))
    if judged.word == "unknown":
        return {"true": true, "end": "right" if search.rivals & {*names} else "open"}
    end = "right" if judged.names == names else "wrong"
    return {"true": true, "end": "open" if still_open(new, judged) else end}


def driven(
    problem: Problem, fit: Fitted, planned: Planned, signals: Sequence[str], rng: np.random.Generator
) -> Run:  # fmt: skip
    """The log of a planned run by a machine drawn from what a fit leaves open, sampled, noisy and in error as the
    campaign's last run is. signals: logged beside that run's."""
    last, at = problem.runs[-1], planned.run
    t: Array = np.arange(round(at.duration_s / last.sample_time_s) + 1, dtype=float) * last.sample_time_s
    motion = {name: np.interp(t, at.time_s, at[name]) for name in at.signals if name in last or name in signals}
    ahead = Problem(problem.machine, [replace(at, name="next", time_s=t, signals=motion)], problem.band_hz)
    low, high, _ = bounds_of(fit.free)
    values, vectors = np.linalg.eigh(covariance(problem, fit))
    z = np.clip(fit.z + vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.normal(size=len(values))), low, high)
    setting = {symbol: float(rng.uniform(0.0, 2.0 * np.pi)) if isinstance(value, tuple) else value
               for symbol, value in setting_of(fit.free, z).items()}  # fmt: skip
    setting.setdefault(TENSION_GAIN, 1.0 + LOAD_CELL_STD * rng.normal())
    (table,) = tables = ahead.tables([setting])
    (required,), sensed = ahead.bench.required(tables), machine_kind(problem.machine).sensor_of(problem.machine)
    gain, offset = (setting.get(key, value) for key, value in zip((GAIN, OFFSET), sensed, strict=True))
    force = ahead._logged(0, required[:, 0], table, False)[:, 0] * gain + offset
    ahead.bench.measured[0] = force  # the model error grows with it
    moving, standstill = model_error_of(ahead.bench, [np.arange(len(t))])
    whole, at_rest = score_of(problem, fit).sizes
    own = np.zeros(len(t))
    for i, carry in enumerate(carries(ahead.bench, [np.arange(len(t))])):
        own[i] = carry * own[i - 1] + np.sqrt(1.0 - carry**2) * rng.normal()
    plant = problem.bench.plant
    logged = {**motion, plant.input: force + own * whole * np.hypot(moving, at_rest * standstill)}
    if ahead.line is not None:
        logged[ahead.line.signal] = setting[TENSION_GAIN] * ahead._tension(
            t, required[:, 1:, 0], ahead._parameters(table, 0)
        )
    for name, values in logged.items():
        noise = float(np.median(channel_noise(last[name], last.time_s))) if name in last else CELL * np.mean(values)
        logged[name] = values + noise * rng.normal(size=len(t))
    return replace(ahead.runs[0], signals=logged)


def rejudged(search: SearchResult, fits: Sequence[Fitted], run: Run) -> tuple[SearchResult, Judged]:
    """The campaign with one more run: the open hypotheses and the parts of such as have several effects, refitted."""
    old = search.problem
    problem = with_motion_noise(Problem(old.machine, [*old.runs, run], old.band_hz), 0).with_model_error(
        old.errors.sizes
    )
    problem.deaf = old.deaf
    cell = base_parameters(problem.machine, problem.runs).get(TENSION_GAIN)

    def again(fit: Fitted) -> Fitted:
        free, z, at = list[FreeParameter](), list[float](), 0
        if cell is not None and not old.has_tension:
            free, z = [cell], [0.0]
        for one in fit.free:
            mine, at = fit.z[at : at + one.size], at + one.size
            if isinstance(one, PhaseOfEachRun):
                one, mine = replace(one, start=(*one.start, one.start[-1])), np.append(mine, 0.0)
            free.append(one)
            z += mine.tolist()
        return fit_hypothesis(problem, fit.effects, free, np.array(z))

    asked = {tuple(sorted(fit.effects)): fit for fit in fits if fit.effects}
    parts = {(name,): search.fits[name,] for names in asked for name in names if (name,) in search.fits}
    near, base = again(search.within_tolerances), search.base
    base = near if base is search.within_tolerances else again(base)
    new = replace(search, problem=problem, base=base, within_tolerances=near, linear={}, signatures=(), failures={},
                  fits={names: again(fit) for names, fit in (parts | asked).items()})  # fmt: skip
    return new, judged_to_help(new)


def still_open(search: SearchResult, judged: Judged) -> bool:
    """Whether a diagnosis would ask for a further run."""
    problem, kind = search.problem, search.problem.active.kind
    if len(open_hypotheses(judged, alternatives(search, judged))) > 1:
        return True
    if judged.word != "named" or not variety(problem.bench):
        return False
    answer, rivals = search.fits[judged.names], [search.fits[names] for names in runners_up(judged, kind)]
    known = compared([on_campaign(problem, fit) for fit in (answer, *rivals)], favoured=True)
    return any(distances(answer, rival, [one])[0] <= APART for rival, one in zip(rivals, known, strict=True))


def _with(
    folder: Path, order: Order, content: Content, run: Mapping[str, Any], before: Path, true: str
) -> dict[str, Any]:
    d = _diagnosed(folder, order, extended(content, run, before))
    right = d.verdict.word == "named" and d.verdict.effects == (true,)
    open_ = d.next_run.why.partition(";")[0] if d.next_run else ""
    return {"named": d.verdict.effects or [d.verdict.word], "right": right, "settled": right and not open_,
            "alike": d.verdict.alike, "open": open_, "probability": d.verdict.probability}  # fmt: skip


def _diagnosed(folder: Path, order: Order, content: Content) -> Diagnosis:
    shutil.rmtree(folder, ignore_errors=True)
    make_campaign(folder, order.seed, content)
    return diagnose(read_campaign(folder), study=False)


if __name__ == "__main__":
    main()
