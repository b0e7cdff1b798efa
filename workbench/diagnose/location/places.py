"""Where an unknown cause lies: each part of the machine with its probability.

Every port is weighed as the place where the unknown force enters, by the marginal likelihood of what the runs leave
unexplained. The weights that ports have beforehand matter only
where the runs cannot tell them apart.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

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

SHOWN = 0.005  # probability
TOGETHER = 1000  # columns that are whitened at once


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
    return weighed(survey_of(problem, fit))


def weighed(survey: Survey) -> Placed:
    """Every port weighed on a survey."""
    weigher = Weigher(survey)
    best: dict[str, tuple[float, Port, Evidence]] = {}
    logs: dict[str, list[float]] = {}
    pulses = pulses_of(survey, weigher)
    brief = list(event_ports(survey, pulses)) if pulses is not None else []
    for port, found in evidence_of(weigher, (*Ports(survey).all(), *brief)):
        price = pulses.choices if pulses is not None and port.regime == "event" else 0.0
        log = found.log - price + float(np.log(port.weight))
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


def evidence_of(weigher: Weigher, ports: Iterable[Port]) -> Iterator[tuple[Port, Evidence]]:
    """Each port with its evidence; some of them are whitened together, which is quicker."""
    waiting: list[Port] = []
    for port in ports:
        waiting.append(port)
        if sum(each.columns.shape[1] for each in waiting) >= TOGETHER:
            yield from _weighed_together(weigher, waiting)
            waiting = []
    if waiting:
        yield from _weighed_together(weigher, waiting)


def _weighed_together(weigher: Weigher, ports: list[Port]) -> Iterator[tuple[Port, Evidence]]:
    found = weigher.evidences([each.columns for each in ports], [each.positive for each in ports])
    yield from zip(ports, found, strict=True)
