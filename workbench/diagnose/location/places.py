"""Where an unknown cause lies: each part of the machine with its probability.

The unknown force may enter at any port. The probability of a port follows from the marginal likelihood of the
unexplained residual and from its prior weight, which matters only between ports that the runs cannot tell apart.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from workbench.core.run import Array
from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.location.events import Pulse, event_ports, pulses_of
from workbench.diagnose.location.evidence import Evidence, Weigher
from workbench.diagnose.location.ports import Port, Ports
from workbench.diagnose.location.records import PlaceProbability
from workbench.diagnose.location.survey import Survey, survey_of

SHOWN = 0.005  # probability
TOGETHER = 1000  # columns that are whitened at once


@dataclass(frozen=True)
class Placed:
    """The probabilities of all places, the largest first. port: the best one; part: (inputs,) its contribution, N m
    (N). pulses: the brief events, if the cause is one."""

    places: tuple[PlaceProbability, ...]
    port: Port
    part: Array
    gain: float
    pulses: tuple[Pulse, ...] = ()


def places_of(problem: Problem, fit: Fitted, seed: int = 0) -> tuple[PlaceProbability, ...]:
    """The places where the residual of `fit`, the base parameters alone, may enter; probabilities sum to one."""
    return placed(problem, fit).places


def placed(problem: Problem, fit: Fitted, own: int | None = None) -> Placed:
    """As `places_of`, with the best port and its part of the gap. own: see `survey_of`."""
    return weighed(survey_of(problem, fit, own))


def weighed(survey: Survey) -> Placed:
    """The probabilities of all ports on a survey."""
    weigher = Weigher(survey)
    best: dict[str, tuple[float, Port, Evidence]] = {}
    logs: dict[str, list[float]] = {}
    pulses = pulses_of(survey, weigher)
    brief = list(event_ports(survey, pulses)) if pulses is not None else []
    for port, evidence in evidence_of(weigher, (*Ports(survey).all(), *brief)):
        price = pulses.choices if pulses is not None and port.regime == "event" else 0.0
        log = evidence.log - price + float(np.log(port.weight))
        logs.setdefault(port.subsystem, []).append(log)
        if port.subsystem not in best or log > best[port.subsystem][0]:
            best[port.subsystem] = log, port, evidence
    score = {name: float(logsumexp(terms)) for name, terms in logs.items()}
    total = logsumexp(list(score.values()))
    order = sorted(score, key=lambda name: -score[name])
    _, port, evidence = best[order[0]]
    places = [PlaceProbability(name, float(np.exp(score[name] - total))) for name in order]
    kept = [place for place in places if place.probability > SHOWN]
    share = sum(place.probability for place in kept)
    return Placed(
        places=tuple(PlaceProbability(place.subsystem, place.probability / share) for place in kept),
        port=port,
        part=weigher.part(port.columns, evidence)[: survey.inputs],
        gain=evidence.log - weigher.nothing(),
        pulses=pulses.pulses if pulses is not None and port.regime == "event" else (),
    )


def evidence_of(weigher: Weigher, ports: Iterable[Port]) -> Iterator[tuple[Port, Evidence]]:
    """Each port with its evidence; some of them are whitened together, which is quicker."""
    waiting: list[Port] = []
    for port in ports:
        waiting.append(port)
        if sum(queued.columns.shape[1] for queued in waiting) >= TOGETHER:
            yield from _weighed_together(weigher, waiting)
            waiting = []
    if waiting:
        yield from _weighed_together(weigher, waiting)


def _weighed_together(weigher: Weigher, ports: list[Port]) -> Iterator[tuple[Port, Evidence]]:
    evidences = weigher.evidences([port.columns for port in ports], [port.positive for port in ports])
    yield from zip(ports, evidences, strict=True)
