"""Where an unknown cause lies: each part of the machine with its probability.

Every port is weighed as the place where the unknown force enters, by the marginal likelihood of what the runs leave
unexplained. The weights that ports have beforehand matter only
where the runs cannot tell them apart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from workbench.diagnose.hypotheses.fits import Fitted
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.location.events import Pulse, event_ports, pulses_of
from workbench.diagnose.location.evidence import Evidence, Weigher
from workbench.diagnose.location.ports import Port, Ports
from workbench.diagnose.location.records import PlaceProbability
from workbench.diagnose.location.survey import Survey, survey_of
from workbench.run import Array

# No model is exact: what it leaves hangs together in time, and counts for less than as many independent values.
# Set by eye: on 21 simulated campaigns the logarithmic score hardly changes between 1 and 20.
DOUBT = 3.0
SHOWN = 0.005  # probability
BAND_HZ = 20.0  # beyond, an axis' log shows the noise of its differentiated speed more than a force


@dataclass(frozen=True)
class Placed:
    """The ports weighed. places: the likeliest first. port: the best one; part: (inputs,) what it adds, N m (N).
    pulses: the brief stretches, where that is what it is."""

    places: tuple[PlaceProbability, ...]
    port: Port
    part: Array
    gain: float
    pulses: tuple[Pulse, ...] = ()


def places_of(problem: Problem, fit: Fitted, seed: int = 0) -> tuple[PlaceProbability, ...]:
    """Where what `fit`, the base parameters' own, leaves unexplained enters; probabilities sum to one."""
    return placed(problem, fit).places


def placed(problem: Problem, fit: Fitted) -> Placed:
    """As `places_of`, with the best port and its part of the gap at the problem's rows."""
    narrow = problem if problem.band_hz <= BAND_HZ else Problem(problem.machine, problem.runs, BAND_HZ)
    if narrow is problem:
        return weighed(survey_of(problem, fit))
    narrow.noise = problem.noise * float(np.sqrt(BAND_HZ / problem.band_hz))
    residual, jacobian = narrow.evaluate(fit.knobs, fit.z)
    found = weighed(survey_of(narrow, replace(fit, residual=residual, jacobian=jacobian)))
    return replace(found, part=_at_rows_of(problem, narrow, found.part))


def _at_rows_of(problem: Problem, narrow: Problem, part: Array) -> Array:
    """A part at the rows of a wider band."""
    out, at = [], 0
    for run, rows, coarse in zip(problem.runs, problem.rows, narrow.rows, strict=True):
        mine = part[at : at + len(coarse)]
        out.append(np.interp(run.time_s[rows], run.time_s[coarse], mine) if len(coarse) else np.zeros(len(rows)))
        at += len(coarse)
    return np.concatenate(out)


def weighed(survey: Survey) -> Placed:
    """Every port weighed on a survey."""
    weigher = Weigher(survey)
    best: dict[str, tuple[float, Port, Evidence]] = {}
    logs: dict[str, list[float]] = {}
    pulses = pulses_of(survey, weigher)
    brief = list(event_ports(survey, pulses)) if pulses is not None else []
    for port in (*Ports(survey).all(), *brief):
        found = weigher.evidence(port.columns, port.positive)
        price = pulses.choices if pulses is not None and port.regime == "event" else 0.0
        log = (found.log - price) / DOUBT + float(np.log(port.weight))
        logs.setdefault(port.subsystem, []).append(log)
        if port.subsystem not in best or log > best[port.subsystem][0]:
            best[port.subsystem] = log, port, found
    score = {name: float(logsumexp(each)) for name, each in logs.items()}
    total = logsumexp(list(score.values()))
    order = sorted(score, key=lambda name: -score[name])
    _, port, found = best[order[0]]
    places = [PlaceProbability(name, float(np.exp(score[name] - total))) for name in order]
    kept = [each for each in places if each.probability > SHOWN]
    share = sum(each.probability for each in kept)
    return Placed(
        places=tuple(PlaceProbability(each.subsystem, each.probability / share) for each in kept),
        port=port,
        part=weigher.part(port.columns, found)[: survey.inputs],
        gain=found.log - weigher.nothing(),
        pulses=pulses.pulses if pulses is not None and port.regime == "event" else (),
    )
