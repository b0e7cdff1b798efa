"""More runs of the same true machine, once the seal is open: the recommended one, and one more of the user's own."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.validation.campaign import identify_first, make_campaign
from benchmarks.validation.content import Content
from benchmarks.validation.entry import content_of
from benchmarks.validation.kind import RunPlan
from benchmarks.validation.rig import Rig, rig_from
from workbench.blind.measures import Row, single
from workbench.blind.run import Answer, answer
from workbench.blind.score import Score
from workbench.blind.seal import Order
from workbench.core.errors import InputError
from workbench.diagnose.diagnose import chosen_effects
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.search import Search, SearchResult
from workbench.diagnose.hypotheses.signatures import signatures_of
from workbench.diagnose.isolability import isolability
from workbench.diagnose.isolation.planned import from_moves
from workbench.logs import read_campaign
from workbench.machines import kind_of

BETWEEN_S = 60.0


def answered_with_next_run(said: Mapping[str, Any], rig: Mapping[str, Any] | None, row: Row) -> Answer:
    """The diagnosis of the same machine's runs and of the one that was recommended. said: its order; rig: as sealed."""
    order = Order(**{**said, "seed": tuple(said["seed"]), "names": tuple(said["names"])})
    seeds = tuple(row["label"]["seed"])
    content = content_of(order, rig_from(rig) if rig else None, seeds)
    with tempfile.TemporaryDirectory(prefix="workbench-blind-") as temporary:
        before, after = Path(temporary) / "before", Path(temporary) / "after"
        make_campaign(before, seeds, content)
        make_campaign(after, seeds, extended(content, row["next_run"], before))
        if order.identified:
            identify_first(after, seeds, content)
        return answer(after)


def extended(content: Content, recommended: Mapping[str, Any], campaign: Path) -> Content:
    """The content with the recommended run, and with what it asks to log. campaign: its runs, as the menu saw them."""

    read = read_campaign(campaign)
    problem = Problem(read.machine, read.runs)
    wanted = ("start_position", "speed", "moves")
    if missing := [key for key in wanted if key not in recommended]:
        raise InputError(f"the recommended run lacks {', '.join(missing)}", file=campaign)
    start, speed, moves = (recommended[key] for key in wanted)
    planned = from_moves(problem, recommended["payload_kg"], start, speed, moves)
    run, kind = planned.run, content.kind
    speed = run[problem.bench.plant.speeds[0]]
    t = np.arange(round(run.duration_s / kind.record_s)) * kind.record_s
    reference = tuple(float(v) for v in np.interp(t, run.time_s - run.time_s[0], speed))
    logged = kind_of(read.machine).moved.placed_by_log
    start = float(run[problem.bench.plant.positions[0]][0] if logged else run.start_position_m)
    began = content.runs[-1].start_time_s + content.runs[-1].duration_s + BETWEEN_S
    logs = ("tension",) if "tension_dead_line_n" in recommended["signals"] else ()
    plan = RunPlan(
        "next", "recommended", run.payload_kg, start, round(began, 2), len(t) * kind.record_s, reference, logs
    )
    return replace(content, runs=(*content.runs, plan))


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
    if not kind_of(rig.drawn.machine).holds_load:
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

    with tempfile.TemporaryDirectory(prefix="workbench-blind-") as temporary:
        folder = Path(temporary) / "campaign"
        make_campaign(folder, seeds, content)
        campaign = read_campaign(folder)
        problem = Problem(campaign.machine, campaign.runs)
        effects = chosen_effects(campaign, None)
        base = Search(problem, effects).base_fit()
        search = SearchResult(problem, base, base, {}, {}, signatures_of(problem, effects, base.setting))
        return {name: amount for name, (_, amount) in isolability(problem, search).visible.items()}
