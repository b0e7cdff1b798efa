"""The cause of an alarm: the diagnosis of its cycles, and causes that it cannot discriminate, beside the healthy ones.

A diagnosis allows for what a lumped model of any machine may miss, so that an offset of the torque sensor, a heavier
carriage and a heavier wire stay alike however many cycles it is given. The machine's own healthy cycles miss the same:
the difference between them and the cycles since a change holds the sensors' and the machine's scatter only. With the
mean deviations w of n cycles at one payload, whitened by the baseline's covariance, and the shift s of the estimates
under a cause as the diagnosis fitted it,

    w ~ N(s, K),    K = scale (1/n + 1/N) I + s s' + S S'

S: what one standard error of each of the cause's parameters adds; s s' lets its size be another, for a change may grow;
N: cycles of the baseline; scale: the largest of 1 and the reduced chi² of the best cause, for what no cause explains
widens the errors. Gaussian evidence: D. J. C. MacKay, Neural Computation 4, 1992. Payloads stand below each other.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from workbench.core.errors import InputError
from workbench.core.names import unit_of, words_of
from workbench.core.run import Array, Run
from workbench.diagnose.diagnose import Diagnosis, diagnose
from workbench.diagnose.hypotheses.fit import Fitted, estimates
from workbench.diagnose.machines import machine_of, with_effects
from workbench.logs import Campaign
from workbench.machines import AnyMachine, Machine, get_value, kind_of, with_values
from workbench.watch.estimate import Baseline, shift
from workbench.watch.judge import SAME_PAYLOAD_KG, Cycle


@dataclass(frozen=True)
class Group:
    """Cycles of one payload since the change. deviation: (r,), their whitened mean; run: one of them."""

    payload_kg: float
    count: int
    deviation: Array
    run: Run


def groups_of(cycles: Sequence[Cycle], runs: Sequence[Run], baseline: Baseline) -> list[Group]:
    """The cycles by payload, of those payloads that a run stands for."""
    made: list[Group] = []
    for run in runs:
        payload = run.payload_kg
        alike = [c for c in cycles if abs(c.payload_kg - payload) <= SAME_PAYLOAD_KG]
        if alike and all(abs(payload - group.payload_kg) > SAME_PAYLOAD_KG for group in made):
            z = [baseline.z(baseline.deviation(c.estimate.values, c.payload_kg), c.payload_kg) for c in alike]
            made.append(Group(payload, len(alike), np.asarray(np.mean(z, axis=0)), run))
    return made


@dataclass(frozen=True)
class Cause:
    """fitted: the machine with a cause as the diagnosis fitted it; others: with one parameter a standard error off."""

    fitted: Machine
    others: tuple[Machine, ...] = ()


def likelihoods(
    machine: Machine, causes: Mapping[str, Cause], groups: Sequence[Group], baseline: Baseline
) -> dict[str, float]:
    """Logarithm of the likelihood of each cause, 0 for the best. machine: as its logs were estimated with."""
    deviation = np.concatenate([group.deviation for group in groups])
    noise = np.concatenate([np.full(len(g.deviation), 1.0 / g.count + 1.0 / baseline.count) for g in groups])

    def shifts(other: Machine) -> Array:
        moved = [baseline.z(shift(machine, g.run, other, baseline.keys), g.payload_kg) for g in groups]
        return np.concatenate(moved)

    columns = {}
    for name, cause in causes.items():
        own = shifts(cause.fitted)
        columns[name] = np.column_stack([own, *(shifts(other) - own for other in cause.others)])
    left = {name: _normal(deviation, column, noise)[1] for name, column in columns.items()}
    scale = max(1.0, min(left.values()) / len(deviation))
    logs = {name: _normal(deviation, column, scale * noise)[0] for name, column in columns.items()}
    return {name: log - max(logs.values()) for name, log in logs.items()}


def _normal(deviation: Array, columns: Array, noise: Array) -> tuple[float, float]:
    """Logarithm of the density of N(first column, columns columns' + noise), but for a constant; and chi²."""
    covariance = columns @ columns.T + np.diag(noise)
    off = deviation - columns[:, 0]
    chi2 = float(off @ np.linalg.solve(covariance, off))
    return -0.5 * (chi2 + float(np.linalg.slogdet(covariance)[1])), chi2


def posterior(before: Mapping[str, float], logs: Mapping[str, float]) -> dict[str, float]:
    """Probabilities of causes: what they were together, shared anew by their likelihoods."""
    weights = {name: probability * float(np.exp(logs[name])) for name, probability in before.items()}
    share = sum(before.values()) / sum(weights.values())
    return {name: weight * share for name, weight in sorted(weights.items(), key=lambda pair: -pair[1])}


Effects = Mapping[str, Mapping[str, float]]
Row = tuple[list[str], str, float]  # effects of a hypothesis, its verdict and its probability
UNLIKELY = 0.005  # a cause less probable in the diagnosis stays so


def diagnosed(campaign: Campaign, baseline: Baseline, cycles: Sequence[Cycle], explained: Effects) -> dict[str, Any]:
    """Verdict, effects with their probabilities and fitted values, and the sentence. InputError where it cannot be
    diagnosed.

    campaign: the runs to diagnose; cycles: all that count since the change; explained: effects that earlier alarms
    found, as they are by now: the machine has them, and the cause is looked for beside them. What the runs cannot
    discriminate, the cycles may.
    """
    machine, explained = campaign.machine, {name: dict(values) for name, values in explained.items()}
    known = with_effects(machine, {**machine.effects, **explained}) if {**machine.effects, **explained} else machine
    made = diagnose(replace(campaign, machine=healthy(known, baseline)), most_effects=1, study=False)
    named, effects, sentence = made.verdict.word == "named", list(made.verdict.effects), made.verdict.sentence
    rows: list[Row] = [(list(row.effects), row.verdict, row.probability) for row in made.verdict.ranking]
    if named:
        rows, apart = _discriminated(made, machine, rows, campaign.runs, cycles, baseline)
        if apart:
            effects, sentence = rows[0][0], f"{apart} {sentence}"
    fit = made.search.fits.get(tuple(effects)) if named else None  # none where a value is each run's own
    fitted = {} if fit is None else machine_of(made.search.problem, {}, tuple(effects), fit.setting).effects
    found = {name: {key: float(value) for key, value in fitted[name].items()} for name in effects} if fitted else {}
    ranking = sorted(rows, key=lambda row: -row[2])[:5]
    return {
        "verdict": made.verdict.word,
        "effects": effects,
        "sentence": sentence,
        "ranking": [{"effects": e, "verdict": word, "probability": p} for e, word, p in ranking],
        "runs": [run.name for run in campaign.runs],
        "fitted": explained | found,
    }


def _discriminated(
    made: Diagnosis, machine: Machine, rows: Sequence[Row], runs: Sequence[Run], cycles: Sequence[Cycle],
    baseline: Baseline,
) -> tuple[list[Row], str]:  # fmt: skip
    """The ranking with the cycles' say, the likeliest cause first, and a sentence; as it was where there is nothing to
    discriminate."""
    singles = {e[0]: p for e, word, p in rows if word == "named" and len(e) == 1 and p > UNLIKELY}
    fits = {name: made.search.fits[(name,)] for name in singles if (name,) in made.search.fits}
    groups = groups_of(cycles, runs, baseline)
    if len(fits) < 2 or not groups:
        return list(rows), ""
    causes = {name: _cause(made, name, fit) for name, fit in fits.items()}
    after = posterior({name: singles[name] for name in causes}, likelihoods(machine, causes, groups, baseline))
    named: list[Row] = [([name], "named", p) for name, p in after.items()]
    others = [row for row in rows if not (row[1] == "named" and len(row[0]) == 1 and row[0][0] in after)]
    (first, p), (second, p_second), *_ = after.items()
    count = sum(group.count for group in groups)
    sizes = (
        f"{words_of(row.name)} {_plain(row.value, 3)} ± {_plain(row.std_error, 2)} {unit_of(row.name)}".strip()
        for row in estimates(made.search.problem, fits[first])[first]
    )
    by = f"by {count} cycle{'s' if count > 1 else ''} beside the healthy ones"
    told = f"The change comes from {first} (probability {p:.2f}; {', '.join(sizes)}), {by}"
    return named + others, f"{told}; next {second} ({p_second:.2f}). The last runs alone:"


def _first(value: float | tuple[float, ...]) -> float:
    return value[0] if isinstance(value, tuple) else value


def _plain(value: float | tuple[float, ...], digits: int) -> str:
    """A number of so many digits, without an exponent where it can be."""
    return f"{float(f'{_first(value):.{digits}g}'):g}"


def _cause(made: Diagnosis, name: str, fit: Fitted) -> Cause:
    """The machine with a cause as it was fitted, and with each of its parameters a standard error off."""
    fitted, others = machine_of(made.search.problem, {}, (name,), fit.setting), []
    for estimate in estimates(made.search.problem, fit, exact=True)[name]:
        off = {estimate.name: fitted.effects[name][estimate.name] + _first(estimate.std_error)}
        with contextlib.suppress(InputError):  # beyond what the effect can be
            others.append(with_effects(fitted, {**fitted.effects, name: {**fitted.effects[name], **off}}))
    return Cause(fitted, tuple(others))


def healthy(machine: AnyMachine, baseline: Baseline) -> AnyMachine:
    """The machine with tolerances as narrow as its healthy cycles scatter: what a new machine may be off by says
    nothing of how far this one may move. No tolerance becomes wider than it was."""
    kind = kind_of(machine)
    narrow: dict[str, float] = {}
    for key, spread in zip(baseline.keys, np.sqrt(np.diag(baseline.covariance)), strict=True):
        value = kind.base_value(key)
        if value is None or not value.tolerance:
            continue
        name = f"tolerances.{value.tolerance}"
        size = float(spread) if value.spread == "absolute" else float(spread) / abs(get_value(machine, key))
        narrow[name] = max(size, narrow.get(name, 0.0))
    return with_values(machine, {name: min(size, get_value(machine, name)) for name, size in narrow.items()})
