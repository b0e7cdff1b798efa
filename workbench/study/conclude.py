"""What a study says: its decision, the number that it asks for, then at most three findings that could change it."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from workbench.core.errors import InputError
from workbench.core.names import listed
from workbench.core.whole_folder import write_json
from workbench.machines import Machine, kind_of
from workbench.metrics import View, set_of, shown_in
from workbench.study import labels
from workbench.study import rows as tables
from workbench.study.beside import (
    Asked,
    answers,
    asked_sentences,
    beside,
    beyond_its_limits,
    from_the_bound,
    on_another_damping,
)
from workbench.study.decide import OVERSPEED, SATURATED, WIRE_SAFETY, Candidate, decisions, take_sentences
from workbench.study.front import Front, fronts
from workbench.study.labels import Label, SweptAxis, field_label, reads, said, shown, words_of
from workbench.study.load import Study
from workbench.study.rows import Row, metrics_of
from workbench.study.run import StudyResult, peak_limit

ANSWER, EQUAL_TIME = "answer.json", "equal_time.parquet"
MOST_FINDINGS, MOST_FAILED = 3, 3
MOST_BYTES = 1_000_000
QUANTILES = (0.05, 0.5, 0.95)
AT_THE_LIMIT = 0.85  # rms over limit: three quarters of the time are spent there


@dataclass(frozen=True)
class Correlation:
    """Spearman's rank correlation of a drawn field with a metric."""

    column: str
    value: float

    @property
    def label(self) -> Label:
        return field_label(self.column)


def rank_correlations(rows: Sequence[Row], columns: Sequence[str], metric: str) -> list[Correlation]:
    """Of each field with the metric, the strongest first; a field or metric that is constant is left out."""
    good = [row for row in rows if row.ok]
    if len(good) < 3 or not columns:
        return []
    from scipy.stats import rankdata  # half a second

    wanted, correlations = rankdata([row[metric] for row in good]), []
    for column in columns:
        values = [row.assigned.get(column) for row in good]
        if any(value is None or isinstance(value, str) for value in values):
            continue
        drawn = rankdata(values)
        if np.ptp(drawn) > 0.0 and np.ptp(wanted) > 0.0:
            correlations.append(Correlation(column, float(np.corrcoef(drawn, wanted)[0, 1])))
    return sorted(correlations, key=lambda field: -abs(field.value))


def sentences(rows: Sequence[Row], limit: float) -> list[str]:
    """All findings, first what went wrong. limit: the largest torque of one motor, an axis' largest input, or inf."""
    return [*troubles(rows, limit), *variations(rows)]


def troubles(rows: Sequence[Row], limit: float) -> list[str]:
    """Runs that failed, are at a limit, hunt, go slack or end elsewhere: each can turn the decision round."""
    good, axes = [row for row in rows if row.ok], labels.swept_axes(rows)
    found = []
    if failed := [row for row in rows if not row.ok]:
        found.append(" ".join(f"{row.run_id} failed: {row.reason}." for row in failed[:MOST_FAILED]))
        if len(failed) > MOST_FAILED:
            found[0] += f" {len(failed) - MOST_FAILED} more of {len(rows)} runs failed; the index says why."
    if not good:
        return found
    judged = metrics_of(good)
    own_limits = any("drive." in column or "motor." in column for column in good[0].assigned)
    at_limit = [row for row in good if row[judged.peak] >= limit * (1.0 - 1e-9) and not own_limits]
    stuck = [row for row in at_limit if row[judged.rms] >= AT_THE_LIMIT * limit]
    # What is so, of which runs, and by what the worst of them is.
    troubled: tuple[tuple[str, list[Row], Callable[[Row], float] | None], ...] = (
        ("limit", [row for row in at_limit if row not in stuck], None),
        ("stuck", stuck, None),
        ("hunts", [row for row in good if tables.hunts(row)], tables.swings_per_s),
        ("slack", [row for row in good if row.get("slack_time_s") > 0.0], lambda row: row["slack_time_s"]),
        ("astray", [row for row in good if tables.is_astray(row)], lambda row: abs(row[judged.end])),
    )
    for what, some, size in troubled:
        names = [labels.run_in_words(row, axes) for row in some]
        if len(names) > (3 if good[0].assigned else 6):
            names = [f"{len(names)} of {len(good)} runs, the first {names[0]}"]
        worst = max(some, key=size) if some and size else None
        whose = (size(worst), labels.run_in_words(worst, axes)) if worst and size else ()
        found += [said.trouble(what, judged, limit, names, worst, *whose)] if some else []
    return found


def variations(
    rows: Sequence[Row], told: bool = False, beside: Sequence[Row] = (), taken: Candidate | None = None
) -> list[str]:
    """What a sweep or a sample does; of a study that varies nothing, and has `told` no decision, the largest peak.

    beside: runs with further values, among which the knee is sought too. taken: at whose setting the effects are told,
    that of all runs without it.
    """
    good, axes = [row for row in rows if row.ok], labels.swept_axes(rows)
    if not good:
        return []
    judged, heaviest = metrics_of(good), max(row.payload_kg for row in good)
    here = [row for row in good if row.payload_kg == heaviest]
    found: list[str] = []
    if any(".limits." in column for axis in axes for column in axis.columns):
        varied = here[0].assigned.keys()
        further = [row for row in beside if row.payload_kg == heaviest and row.assigned.keys() == varied]
        found += _knee(fronts([*here, *further])[0], axes, labels.swept_axes([*here, *further]))
    for axis in axes:
        fixed = {name: value for name, value in taken.assigned.items() if name not in axis.columns} if taken else {}
        own = [row for row in here if taken and row.reference == taken.reference]
        own = [row for row in own if all(row.assigned.get(name) == value for name, value in fixed.items())]
        whose = [f"with {words_of(own[0].reference).removesuffix(' with the same limits')}"] if own else []
        whose += [one.say(one.at(own[0])) for one in axes if own and fixed.keys() & set(one.columns)]
        found += _effect(axis, own or here, heaviest, ", ".join(whose))
    found += scatter(good) if labels.drawn_columns(good) else []
    if found or told:
        return found
    worst = max(good, key=lambda row: row[judged.peak])
    return [said.largest_peak(judged, judged.by_name[judged.peak].text(worst[judged.peak]), worst)]


def _effect(axis: SweptAxis, rows: Sequence[Row], payload_kg: float, whose: str) -> Iterator[str]:
    """What an axis does at the heaviest payload, of all runs at a value the worst; only of references that read it."""
    own = [row for row in rows if any(reads(row.reference, column) for column in axis.columns)]
    groups = axis.grouped(own)
    if len(groups) < 2:
        return
    points, judged = list(groups), metrics_of(rows)
    several = max(map(len, groups.values())) > 1
    at = f"at {payload_kg:g} kg" if judged.payload else ""
    where = ", ".join(filter(None, (f"{at} {whose}".strip(), "in the worst runs" if several else "")))
    parts, same = [], []
    for metric in shown_in(View.SENTENCES, judged):
        if any(row.metrics.get(metric.name) is None for row in own):
            continue
        values = [metric.scale * metric.worst([row[metric.name] for row in groups[point]]) for point in points]
        if max(values) - min(values) > labels.NO_CHANGE * max(map(abs, values)):
            parts.append(f"the {metric.label} {_course(axis, points, values, metric.shown_unit)}")
        else:
            same.append(metric.label)
    words = axis.words.capitalize()
    if not parts:
        yield f"{words} makes no difference {f'{where} ' if where else ''}to {listed(same)}."
        return
    start = f"{words} from {axis.short(points[0])} to {axis.short(points[-1])}" if axis.numeric else words
    yield f"{start}: {where}{',' if several or whose else ''} {listed(parts)}.".replace(":  ", ": ")


def _course(axis: SweptAxis, points: Sequence[tuple[float | str, ...]], values: Sequence[float], unit: str) -> str:
    """From end to end, with the extreme between them where there is one; of words each."""
    if not axis.numeric:
        return "is " + ", ".join(f"{v:.3g} {unit} with {shown(p[0])}" for p, v in zip(points, values, strict=True))
    text = f"goes from {values[0]:.3g} to {values[-1]:.3g} {unit}"
    reach, ends = max(abs(value) for value in values) * labels.NO_CHANGE, (values[0], values[-1])
    for name, at, beyond in (
        ("least", int(np.argmin(values)), min(ends) - reach - min(values)),
        ("most", int(np.argmax(values)), max(values) - max(ends) - reach),
    ):
        if beyond > 0.0:
            return f"{text}, with its {name}, {values[at]:.3g} {unit}, at {axis.short(points[at])}"
    return text


def _knee(front: Front, axes: Sequence[SweptAxis], wider: Sequence[SweptAxis]) -> Iterator[str]:
    """Where a front of move time against the peak turns, and whether that is beyond the sweep, or at the edge of all
    that was run."""
    knee, judged = front.knee, metrics_of(front.rows)
    if knee is None:
        return
    peak = judged.by_name[front.costs[1]]
    setting = ", ".join(axis.say(axis.at(knee)) for axis in axes)
    ends = [f"{row['move_time_s']:.4g} s for {peak.text(row[peak.name])}" for row in (front.rows[0], front.rows[-1])]
    beyond = [axis.words for axis in axes if axis.numeric and axis.at(knee) not in axis.points]
    edges = [axis.words for axis in wider if axis.edge(knee)]
    yield said.knee(front, judged, peak, setting, ends, beyond, edges)


def scatter(good: Sequence[Row]) -> list[str]:
    """Of a sample: the spread of the peak for each payload and reference, and what it depends on."""
    judged, texts = metrics_of(good), []
    metric = judged.by_name[judged.peak]
    for payload, reference in dict.fromkeys((row.payload_kg, row.reference) for row in good):
        rows = [row for row in good if (row.payload_kg, row.reference) == (payload, reference)]
        if len(rows) < 3:
            continue
        quantiles = map(metric.text, np.quantile([row[judged.peak] for row in rows], (*QUANTILES, 1.0)))
        ranked = rank_correlations(rows, labels.drawn_columns(good), judged.peak)
        strong = [f"{r.label.words} (rank correlation {r.value:+.2f})" for r in ranked if abs(r.value) >= 0.2][:3]
        where = f"at {payload:g} kg with {reference}" if judged.payload else f"with {reference}"
        texts.append(said.scatter(metric, len(rows), where, *quantiles, strong))
    return texts


Light = Literal["green", "amber", "red"]
AMBER, RED = 85.0, 100.0 * (1.0 - SATURATED)  # % of what is borne
MANY = 1000.0  # % from which on a share is said in times
SIGN = {"green": "●", "amber": "▲", "red": "■"}  # told apart without colour, too


@dataclass(frozen=True)
class Use:
    """percent: of what is borne, in the run that uses most. bound: what that is, in words; where: that run.

    told: whether a finding says it too.
    """

    what: str
    percent: float
    bound: str
    where: str
    told: bool = False

    @property
    def used(self) -> str:
        """`104 % of`, `176 times`."""
        return f"{self.percent:.0f} % of" if self.percent < MANY else f"{self.percent / 100.0:.0f} times"

    @property
    def light(self) -> Light:
        return "red" if self.percent >= RED else "amber" if self.percent > AMBER else "green"


def utilisation(rows: Sequence[Row], machine: Machine) -> list[Use]:
    """Torque peak, rms torque, overload, speed, wire, place of the stop; those that the runs know."""
    good, axes = [row for row in rows if row.ok], labels.swept_axes(rows)
    uses = []
    for what, name, scale, bound, told in _hoist_shares(machine) if metrics_of(rows).payload else _axis_shares(machine):
        known = [row for row in good if row.metrics.get(name) is not None]
        if known:
            worst = max(known, key=lambda row: abs(row[name]))
            uses.append(Use(what, scale * abs(worst[name]), bound, labels.run_in_words(worst, axes), told))
    if hunting := [row for row in good if tables.hunts(row)]:
        worst = max(hunting, key=tables.swings_per_s)
        bound = f"{tables.SWINGS_PER_S:g} a second of motion, each by more than nominal torque: the loop hunts"
        percent = 100.0 * tables.swings_per_s(worst) / tables.SWINGS_PER_S
        uses.append(Use("torque swings", percent, bound, labels.run_in_words(worst, axes), True))
    if factors := [row for row in good if row.get("wire_safety_factor") > 0.0]:
        worst = min(factors, key=lambda row: row["wire_safety_factor"])
        bound = f"a safety factor of {WIRE_SAFETY:g} (ISO 4308-1, M5)"
        uses.append(
            Use("wire", 100.0 * WIRE_SAFETY / worst["wire_safety_factor"], bound, labels.run_in_words(worst, axes))
        )
    return uses


Share = tuple[str, str, float, str, bool]  # what, metric, per cent per unit of it, of what, whether a finding says it


def _hoist_shares(machine: Any) -> tuple[Share, ...]:
    limit, nominal, drive = peak_limit(machine), machine.motor.nominal_torque_nm, machine.drive
    overspeed = OVERSPEED if drive.field_weakening else 1.0
    fastest = f"{overspeed:g} times nominal speed, {overspeed * machine.motor.nominal_speed_rad_s:.4g} rad/s"
    cycle = f"{100 * drive.overload:.0f} % for {drive.overload_time_s:g} s in {drive.overload_period_s:g} s"
    place = f"{1000 * tables.ASTRAY_M:g} mm from the reference"
    return (
        ("torque peak", "peak_torque_motor_nm", 100.0 / limit, f"the limit of {limit:.0f} N m per motor", True),
        ("rms torque", "rms_torque_motor_nm", 100.0 / nominal, f"nominal torque, {nominal:g} N m, without end", False),
        ("overload", "overload_use_percent", 1.0, f"the drive's overload cycle, {cycle}", False),
        ("motor speed", "peak_speed_percent", 1.0 / overspeed, fastest, False),
        ("place of the stop", "position_error_end_m", 100.0 / tables.ASTRAY_M, place, True),
    )


def _axis_shares(machine: Any) -> tuple[Share, ...]:
    """Of what the drive states: its limit, what it gives without end, its top speed."""
    drive, kind, judged = machine.drive, kind_of(machine), set_of(kind_of(machine).name)
    unit, word = kind.drive.unit, kind.drive.quantity
    shares: list[Share] = []
    if math.isfinite(drive.limit):
        shares.append((f"{word} peak", judged.peak, 100.0 / drive.limit, f"the limit of {drive.limit:g} {unit}", True))
    if drive.nominal is not None:
        without_end = f"nominal {word}, {drive.nominal:g} {unit}, without end"
        shares.append((f"rms {word}", judged.rms, 100.0 / drive.nominal, without_end, False))
    if drive.top_speed is not None:
        bound = f"the top speed, {drive.top_speed:g} {kind.moved.speed_unit}"
        shares.append(("speed", judged.fastest, 100.0 / drive.top_speed, bound, False))
    return tuple(shares)


def alarm(uses: Sequence[Use]) -> str | None:
    """One sentence on what is at or beyond its bound; None where nothing is."""
    over = [f"{use.what} {use.used} {use.bound} ({use.where})" for use in uses if use.light == "red"]
    return f"Overload: {'; '.join(over)}." if over else None


@dataclass(frozen=True)
class Answer:
    """sentences: the decision first. beside: runs at equal times. asked: the numbers that the scenario asks for."""

    sentences: tuple[str, ...]
    beside: tuple[Row, ...] = ()
    asked: tuple[Asked, ...] = ()


def answer_of(study: Study, rows: Sequence[Row], *, simulate: bool = True) -> Answer:
    """simulate: runs beside the study may be made, for equal times, another damping and the number asked for."""
    rivals: list[Row] = []
    asked: list[Asked] = []
    if simulate:
        with suppress(InputError):  # a comparison that cannot be planned leaves the study's own rows as they are
            rivals, asked = beside(study, rows), answers(study)
    made = decisions(rows, study.machine, study.scenario.decide, rivals)
    taken, best = take_sentences(made), next(one for one in made[-1].candidates if not one.beside)
    alarmed = alarm([use for use in utilisation(rows, study.machine) if not use.told])
    base = not study.scenario.sweep and not study.scenario.sample  # of base values: a sweep has others
    beyond = beyond_its_limits(study) if simulate and base else []
    first = [*asked_sentences(study, asked), *taken, *beyond, *([alarmed] if alarmed else [])]
    found = [*troubles(rows, peak_limit(study.machine)), *variations(rows, bool(taken), rivals, best)]
    if simulate and len(found) < MOST_FINDINGS and (damping := on_another_damping(study)) is not None:
        found.append(damping)
    if len(found) < MOST_FINDINGS and base:
        found += from_the_bound(study)
    return Answer((*first, *found[:MOST_FINDINGS]), tuple(rivals), tuple(asked))


def answer(study: Study, rows: Sequence[Row], *, simulate: bool = True) -> list[str]:
    """The sentences alone."""
    return list(answer_of(study, rows, simulate=simulate).sentences)


def write_answer(result: StudyResult, path: Path) -> None:
    """answer.json, and beside it the runs at equal times as an index of their own."""
    made = answer_of(result.study, result.rows)
    if made.beside:
        path.with_name(EQUAL_TIME).write_bytes(tables.parquet_bytes(tables.index_table(made.beside)))
    asked = [{**vars(one), "broken": list(one.broken)} for one in made.asked]
    write_json(path, {"format": 1, "sentences": list(made.sentences), "asked": asked})


def read_answer(folder: Path) -> Answer | None:
    """The answer that a result holds; None where it holds none that can be read."""
    file, rivals = folder / ANSWER, folder / EQUAL_TIME
    try:
        with file.open("rb") as stream:
            kept = json.loads(stream.read(MOST_BYTES))
        rows = tuple(tables.rows_of(tables.read_table(rivals))) if rivals.is_file() else ()
        asked = tuple(Asked(**{**one, "broken": tuple(one["broken"])}) for one in kept["asked"])
        return Answer(tuple(map(str, kept["sentences"])), rows, asked)
    except (OSError, ValueError, KeyError, TypeError):
        return None
