"""Families of simulated machines: they differ in what they have beside their equations, and are left out in turn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Nuisances:
    """What every machine has beside its model; each is drawn between nothing and the number here.

    viscous: of the Coulomb level, at top speed. gear_loss: of the transmitted torque. eccentricity: of the drum's
    radius. ripple: of the largest input, at each of the orders.
    """

    viscous: float
    gear_loss: float
    eccentricity: float
    ripple: float


@dataclass(frozen=True)
class Logger:
    """How a family's machines are measured and logged.

    noise: of the input, one standard deviation a sample, between these; hoist: N m of each motor; axis: of the
    largest force. encoder, jitter, uneven: shares of the machines whose speed is a differentiated, quantised
    position, whose samples are taken beside their stamps, and whose stamps are uneven. quiet: drive and motion
    sensors have no noise. full: share that logs position and dead-line tension (hoist). plain: share that logs
    the sum of torques only, or no reference (hoist). logs: signals of an axis, and their shares.
    """

    rates_hz: tuple[float, ...]
    noise: tuple[float, float]
    encoder: float = 0.0
    jitter: float = 0.0
    uneven: float = 0.0
    quiet: bool = False
    full: float = 0.1
    plain: float = 0.0
    logs: tuple[tuple[str, ...], ...] = (("position", "speed", "reference"),)


@dataclass(frozen=True)
class Family:
    """sizes: hoist: mass of the carriage, kg; axis: of the spread from gram to tonne, 0 to 1; `machines` names
    given ones in their place. runs, lengths_s: between these. elastic: share of axes of two inertias, resonance_hz:
    of their coupling. profiles: of the runs, drawn where there are none. favoured: every second single effect."""

    name: str
    kind: str
    text: str
    sizes: tuple[float, float]
    nuisances: Nuisances
    laws: tuple[str, ...]
    logger: Logger
    runs: tuple[int, int]
    lengths_s: tuple[float, float]
    machines: tuple[int, ...] = ()
    elastic: float = 0.5
    resonance_hz: tuple[float, float] = (80.0, 300.0)
    profiles: tuple[str, ...] = ()
    favoured: tuple[str, ...] = ()


_HARDLY = Nuisances(viscous=0.02, gear_loss=0.0006, eccentricity=3e-4, ripple=4e-4)
_SHOWING = Nuisances(viscous=0.05, gear_loss=0.003, eccentricity=1.2e-3, ripple=2e-3)
_NONE = Nuisances(0.0, 0.0, 0.0, 0.0)
_BASIC_LAWS = ("tanh", "dahl")
_ALL_LAWS = ("tanh", "smooth_peak", "dahl", "lugre", "creeping")
_PRACTICE = Family(
    "hoist_practice", "hoist", "the two smaller machines of the practice campaigns, six runs at 100 Hz",
    (5200.0, 8000.0), _HARDLY, _BASIC_LAWS, Logger((100.0,), (1.95, 1.95)), (6, 6), (49.76, 49.76), machines=(0, 1),
)  # fmt: skip
_HOIST = replace(_PRACTICE, machines=())
_COGGING = Nuisances(viscous=0.0, gear_loss=0.003, eccentricity=0.0, ripple=7e-3)
_AXIS = Family(
    "axis_std", "axis", "position, speed and reference at 500 Hz or 1 kHz, as the practice axes",
    (0.0, 1.0), _COGGING, _BASIC_LAWS, Logger((500.0, 1000.0), (0.001, 0.01)), (4, 5), (6.0, 10.0),
    profiles=("moves", "sine", "middle", "slow", "moves"),
)  # fmt: skip

_FAMILIES = (
    _PRACTICE,
    replace(
        _PRACTICE, name="hoist_double", text="the larger machine of the practice campaigns, whose nuisances show",
        sizes=(13500.0, 13500.0), machines=(2,), nuisances=_SHOWING, laws=_ALL_LAWS,
    ),
    replace(
        _HOIST, name="hoist_small", text="hoists of 1 to 6 t", sizes=(1000.0, 6000.0), runs=(5, 6),
        lengths_s=(30.0, 50.0),
    ),
    replace(
        _HOIST, name="hoist_middle", text="hoists of 2 to 15 t, four to eight runs at 50 to 200 Hz",
        sizes=(2000.0, 15000.0), runs=(4, 8), lengths_s=(40.0, 75.0),
        logger=Logger((50.0, 100.0, 100.0, 200.0), (1.95, 1.95), full=0.3, plain=0.3),
    ),
    replace(
        _HOIST, name="hoist_large", text="hoists of 12 to 30 t whose nuisances show over the sensors' noise",
        sizes=(12000.0, 30000.0), nuisances=_SHOWING, laws=_ALL_LAWS, runs=(4, 6), lengths_s=(35.0, 50.0),
    ),
    replace(
        _HOIST, name="hoist_standstill", text="hoists that stick, creep or rise near standstill",
        sizes=(1000.0, 30000.0), laws=("smooth_peak", "lugre", "creeping"), nuisances=_SHOWING, runs=(4, 6),
        lengths_s=(30.0, 50.0),
    ),
    replace(
        _HOIST, name="hoist_encoder", text="hoists whose speed is a differentiated, quantised position, with jitter",
        sizes=(1000.0, 30000.0), laws=_ALL_LAWS, runs=(4, 6), lengths_s=(30.0, 50.0),
        logger=Logger((100.0, 200.0), (0.5, 4.0), encoder=1.0, jitter=0.5, plain=0.3),
    ),
    replace(
        _HOIST, name="hoist_rates", text="hoists logged at 50 to 500 Hz in two to ten runs of 10 s to 10 min",
        sizes=(1000.0, 30000.0), laws=_ALL_LAWS, runs=(2, 10), lengths_s=(10.0, 600.0),
        logger=Logger((50.0, 100.0, 250.0, 500.0), (0.5, 4.0), encoder=0.3, plain=0.3),
    ),
    replace(
        _HOIST, name="hoist_clean", text="hoists as their model, logged without noise or nearly so at 50 or 100 Hz",
        sizes=(1000.0, 30000.0), nuisances=_NONE, laws=("tanh",), runs=(4, 6), lengths_s=(30.0, 50.0),
        logger=Logger((50.0, 100.0), (0.0, 0.05), quiet=True),
    ),
    _AXIS,
    replace(
        _AXIS, name="axis_rates", text="axes logged at 100 Hz to 5 kHz, some at uneven steps, in two to ten runs",
        runs=(2, 10), lengths_s=(5.0, 20.0), profiles=(),
        logger=Logger(
            (100.0, 200.0, 250.0, 500.0, 1000.0, 2500.0, 5000.0), (0.001, 0.015), uneven=0.2, jitter=0.2,
            logs=(("position",), ("position", "reference"), ("position", "speed", "reference"), ("speed",)),
        ),
    ),
    replace(
        _AXIS, name="axis_position", text="axes of which position alone is logged", laws=_ALL_LAWS,
        logger=Logger((500.0, 1000.0, 2500.0), (0.001, 0.015), logs=(("position",), ("position", "reference"))),
    ),
    replace(
        _AXIS, name="axis_encoder", text="axes whose speed is a differentiated, quantised position, with jitter",
        laws=_ALL_LAWS,
        logger=Logger(
            (500.0, 1000.0), (0.001, 0.015), encoder=1.0, jitter=0.5,
            logs=(("position", "speed"), ("speed",), ("position", "speed", "reference")),
        ),
    ),
    replace(
        _AXIS, name="axis_two_inertias", text="axes of two inertias over a coupling, some with play in it",
        laws=_ALL_LAWS, elastic=1.0, resonance_hz=(40.0, 250.0), favoured=("backlash",),
    ),
)  # fmt: skip
FAMILIES: Mapping[str, Family] = {family.name: family for family in _FAMILIES}
