"""What can be computed once the seal is open: the true effect's own fit, the recommended run, one more run."""

from __future__ import annotations

import json
import math
import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from workbench.blind import criteria
from workbench.blind.answer import answer, save, text_of
from workbench.blind.criteria import Row, oracle_after, right, right_word, single
from workbench.blind.identified import identify_first
from workbench.blind.make import content_of, mapped
from workbench.blind.orders import Order
from workbench.blind.power import Power, power_of
from workbench.blind.rig import Rig, rig_from
from workbench.blind.score import Score, named
from workbench.blind.seal import CAMPAIGNS
from workbench.blind.sources.simulator.campaign import make_campaign
from workbench.blind.sources.simulator.content import Content
from workbench.blind.sources.simulator.kind import RunPlan
from workbench.errors import InputError
from workbench.kinds import kind_of as machine_kind

NEXT, ORACLE, BETWEEN_S = "next_runs", "oracle", 60.0
Tell = Callable[[str], None]


def with_oracle(score: Score, processes: int, tell: Tell) -> Score:
    """Each case of listed effects with its true effect's held-out rms, fitted where the diagnosis has not. What was
    fitted at an earlier call is kept."""
    lack = [row for row in score.rows if right_word(row) == "named" and oracle_after(row) is None and row["noise"]]
    fitted: dict[str, Row] = {}
    with mapped(processes) as over:
        for row in over(partial(fitted_truth, score.folder), lack):
            fitted[row["folder"]] = row
            tell(f"{len(fitted)}/{len(lack)} true effects fitted")
    return score.with_rows([fitted.get(row["folder"], row) for row in score.rows])


def fitted_truth(folder: Path, row: Row) -> Row:
    """The row with the held-out rms of its label's effects fitted to its runs; as it is where that breaks down."""
    file = folder / ORACLE / f"{row['folder']}.json"
    if not file.exists():
        save(json.dumps(_held_out_of_truth(folder / CAMPAIGNS / row["folder"], sorted(row["label"]["effects"]))), file)
    return {**row, "held_out": [*row["held_out"], *json.loads(file.read_text(encoding="utf-8"))]}


def _held_out_of_truth(folder: Path, told: list[str]) -> list[tuple[list[str], float]]:
    from workbench.diagnose.diagnose import diagnose
    from workbench.logs import read_campaign

    try:
        diagnosis = diagnose(read_campaign(folder), candidates=told, most_effects=len(told), study=False)
    except InputError:
        return []
    return [
        (list(candidate.effects), candidate.held_out_rms)
        for candidate in diagnosis.candidates
        if sorted(candidate.effects) == told and candidate.held_out_rms is not None
    ]


@dataclass(frozen=True)
class WithNextRun:
    """An open case: its answer, and the answer with the recommended run, which was simulated on the same machine."""

    row: Row
    then: Row

    @property
    def settled(self) -> bool:
        """The answer is right then, and leaves nothing open."""
        return right(self.then) and not self.then["next_run"]


def with_next_runs(scores: Sequence[Score], most: int, processes: int, tell: Tell) -> list[WithNextRun]:
    """At most so many open cases of each folder, diagnosed again with their recommended run, where the diagnosis says
    that it decides. What was answered at an earlier call is kept. Campaigns are named as on the sheet of these
    folders."""
    return [
        WithNextRun(*(named(score, row, len(scores) > 1) for row in (before, then)))
        for score in scores
        for before, then in _with_their_next_run(score, most, processes, tell)
    ]


def _with_their_next_run(score: Score, most: int, processes: int, tell: Tell) -> list[tuple[Row, Row]]:
    open_cases = [row for row in score.rows if criteria.next_run_decides(row) and row["label"]["effects"]][:most]
    anew: dict[str, Row] = {}
    with mapped(processes) as over:
        kept = score.folder / NEXT
        for row in over(partial(_answered_anew, score.truth.orders, score.truth.rig, kept), open_cases):
            anew[row["folder"]] = row
            said = "+".join(row["names"]) or row["word"]
            tell(f"{len(anew)}/{len(open_cases)} next run of campaign {row['folder']}: {said}")
    return [(row, anew[row["folder"]]) for row in open_cases]


def _answered_anew(
    orders: Mapping[str, Mapping[str, Any]], rig: Mapping[str, Any] | None, kept: Path, row: Row
) -> dict[str, Any]:
    file = kept / f"{row['folder']}.json"
    if not file.exists():
        order = _order(orders[row["folder"]])
        text = text_of(_with_next_run(order, rig_from(rig) if rig else None, row))
        save(text, file)
    return {**json.loads(file.read_text(encoding="utf-8")), "label": row["label"], "folder": row["folder"]}


def _order(said: Mapping[str, Any]) -> Order:
    return Order(**{**said, "seed": tuple(said["seed"]), "names": tuple(said["names"])})


def _with_next_run(order: Order, rig: Rig | None, row: Row) -> Any:
    """The diagnosis of the same machine's runs and of the one that was recommended."""
    seeds = tuple(row["label"]["seed"])
    content = content_of(order, rig, seeds)
    with tempfile.TemporaryDirectory(prefix="workbench-blind-") as temporary:
        before, after = Path(temporary) / "before", Path(temporary) / "after"
        make_campaign(before, seeds, content)
        make_campaign(after, seeds, extended(content, row["next_run"], before))
        if order.identified:
            identify_first(after, seeds, content)
        return answer(after)


def extended(content: Content, recommended: Mapping[str, Any], campaign: Path) -> Content:
    """The content with the recommended run, and with what it asks to log. campaign: its runs, as the menu saw them."""
    from workbench.diagnose.hypotheses.problem import Problem
    from workbench.diagnose.isolation.planned import menu
    from workbench.kinds import kind_of
    from workbench.logs import read_campaign

    read = read_campaign(campaign)
    problem = Problem(read.machine, read.runs)
    fits = [
        planned
        for planned in menu(problem)
        if _motion(planned.words) == _motion(recommended["profile"]) and planned.payload_kg == recommended["payload_kg"]
    ]
    if not fits:
        raise InputError(f"no run '{recommended['profile']}' on the menu", file=campaign)
    run, kind = fits[0].run, content.kind
    speed = run[problem.bench.plant.speeds[0]]
    t = np.arange(round(run.duration_s / kind.record_s)) * kind.record_s
    reference = tuple(float(v) for v in np.interp(t, run.time_s - run.time_s[0], speed))
    logged = kind_of(read.machine).moved.placed_by_log
    start = float(run[problem.bench.plant.positions[0]][0] if logged else run.start_position_m)
    began = content.runs[-1].start_time_s + content.runs[-1].duration_s + BETWEEN_S
    plan = RunPlan("next", "recommended", run.payload_kg, start, round(began, 2), len(t) * kind.record_s, reference)
    names = {"tension_dead_line_n": "tension", "position_carriage_m": "position"}
    more = [names[signal] for signal in recommended["signals"] if signal in names]
    logs = tuple(dict.fromkeys([*content.logging.logs, *more]))
    return replace(content, runs=(*content.runs, plan), logging=replace(content.logging, logs=logs))


def _motion(words: str) -> str:
    """A motion's words without its speed, which hangs on the band."""
    return re.sub(r"\s*\([^)]*\)", "", words)


def power_of_rig(scores: Sequence[Score]) -> Power | None:
    """The power of the runs of one machine, from all its folders, and what one more run would buy. None where machines
    were drawn, or are not the same in all folders."""
    first = scores[0]
    if not first.truth.rig or any(score.truth.rig != first.truth.rig for score in scores):
        return None
    rows = [row for score in scores for row in score.rows]
    return power_of(first.with_rows(rows), *(one_more_run(first) or ()))


def one_more_run(score: Score) -> tuple[Mapping[str, float], str] | None:
    """effect -> smallest amount that shows with one more run over that without, and which run; None for drawn machines.

    Of a few runs the one that lowers the amounts of the score's effects most, on the whole.
    """
    if not score.truth.rig:
        return None
    rig = rig_from(score.truth.rig)
    asked = {row["label"]["effects"][0] for row in score.rows if single(row)}
    order = Order(0, (score.truth.seed, 0), "simulator", rig.family.name, "none", ())
    content = rig.content(order.seed, order)
    now = shows(content, order.seed)
    best: tuple[float, Mapping[str, float], str] | None = None
    for trial in _trials(rig):
        then = shows(trial.added_to(content), order.seed)
        both = [name for name in now if name in then and 0.0 < now[name] < np.inf and 0.0 < then[name] < np.inf]
        ratios = {name: min(then[name] / now[name], 1.0) for name in both}
        logs = [math.log(ratio) for name, ratio in ratios.items() if name in asked] or [0.0]
        if best is None or sum(logs) < best[0]:
            best = sum(logs), ratios, trial.words
    return None if best is None else best[1:]


@dataclass(frozen=True)
class Trial:
    """One more run. logs: signals that it needs beside those of the rig, in all runs."""

    words: str
    plan: RunPlan
    logs: tuple[str, ...] = ()

    def added_to(self, content: Content) -> Content:
        logs = tuple(dict.fromkeys([*content.logging.logs, *self.logs]))
        return replace(content, runs=(*content.runs, self.plan), logging=replace(content.logging, logs=logs))


def _trials(rig: Rig) -> list[Trial]:
    """The user's own quickest run again: at its lightest load or none, at a quarter of the speed, and on a hoist with
    the dead line's tension, where that is not logged."""
    longest = max(rig.runs, key=lambda run: max(map(abs, run.reference or (0.0,))))
    began = rig.runs[-1].start_time_s + rig.runs[-1].duration_s + BETWEEN_S
    loads = sorted({run.payload_kg for run in rig.runs})
    again = replace(longest, name="one_more", start_time_s=began)
    slow = np.repeat(np.asarray(longest.reference), 4) / 4.0
    slower = replace(again, reference=tuple(map(float, slow)), duration_s=4.0 * longest.duration_s)
    if not machine_kind(rig.drawn.machine).holds_load:
        return [Trial("the quickest one again", again), Trial("the quickest one at a quarter of its speed", slower)]
    tried = []
    for load in dict.fromkeys([0.0, loads[-1]]):
        quick = replace(again, payload_kg=load)
        tried.append(Trial(f"the quickest one with {load:g} kg", quick))
        tried.append(
            Trial(f"the quickest one at a quarter of its speed with {load:g} kg", replace(slower, payload_kg=load))
        )
        if "tension" not in rig.logging.logs:
            words = f"the quickest one with {load:g} kg, and the dead line's tension logged in all runs"
            tried.append(Trial(words, quick, ("tension",)))
    return tried


def shows(content: Content, seeds: tuple[int, ...]) -> Mapping[str, float]:
    """effect -> the smallest amount that these runs would show, in its own unit (see `isolability`)."""
    from workbench.diagnose.diagnose import chosen_effects
    from workbench.diagnose.hypotheses.problem import Problem
    from workbench.diagnose.hypotheses.scan import atoms
    from workbench.diagnose.hypotheses.search import Search, SearchResult
    from workbench.diagnose.isolation.isolability import isolability
    from workbench.logs import read_campaign

    with tempfile.TemporaryDirectory(prefix="workbench-blind-") as temporary:
        folder = Path(temporary) / "campaign"
        make_campaign(folder, seeds, content)
        campaign = read_campaign(folder)
        problem = Problem(campaign.machine, campaign.runs)
        effects = chosen_effects(campaign, None)
        base = Search(problem, effects).base_fit()
        search = SearchResult(problem, base, base, {}, {}, atoms(problem, effects, base.setting))
        return {name: amount for name, (_, amount) in isolability(problem, search).visible.items()}
