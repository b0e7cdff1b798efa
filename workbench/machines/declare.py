"""What a kind of machine is, declared once: names, units, signals, tolerances, and what exists on it.

Plants hold the physics of a kind; this record holds what logs, identification, diagnosis, reports and
dashboard ask about it. A rule that differs from kind to kind reads the record and asks for no class.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np

from workbench.core.run import Array, Run
from workbench.machines.plant import Plant
from workbench.symbolic.expr import Scalar

# What turns over at standstill is a property that nobody knows: a factor of ten either way.
STANDSTILL_LOG_STD = math.log(10.0)
TIME = "time_s"
RESTS_BELOW = 0.01  # of the speed scale, or of the largest speed of all runs: what is slower is at rest
STANDARD_GRAVITY = 9.81  # m/s^2, where machine.yaml has none


@dataclass(frozen=True)
class SignalSet:
    """The signals of a log. `needed`: of each group one alternative must be there, whole. `optional`: taken
    when there."""

    needed: tuple[tuple[tuple[str, ...], ...], ...]
    optional: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        listed = [name for group in self.needed for alternative in group for name in alternative]
        return tuple(dict.fromkeys([*listed, *self.optional]))


@dataclass(frozen=True)
class Input:
    """The input. quantity: in words; unit: for people; suffix: of keys. parts: signals that are its parts, each
    motor's; the input is their sum."""

    quantity: str
    unit: str
    suffix: str
    parts: tuple[str, ...] = ()


@dataclass(frozen=True)
class Moved:
    """What moves, in words, and where it is. unit: of its displacement. placed_by_log: whether the log's position says
    where it is; else the run's start position and the driven coordinate's displacement do."""

    noun: str
    unit: str
    position: str
    placed_by_log: bool

    @property
    def speed_unit(self) -> str:
        return f"{self.unit}/s"


@dataclass(frozen=True)
class Directions:
    """names: of the two directions, up or forward first. one_way: (what runs of one way only do, what they lack) for
    each way. positive: how the sign convention is said."""

    names: tuple[str, str]
    one_way: tuple[tuple[str, str], tuple[str, str]]
    positive: str


@dataclass(frozen=True)
class Friction:
    """The nominal friction law of the plant.

    levels: symbols of the Coulomb levels, forward and backward. off: symbols set to these values leave the Coulomb
    part alone. speed: the plant's state that it acts on. law(v, p): force or torque along v, of numbers or arrays.
    viscous: whether it has a part in proportion to the speed. unit: of law.
    """

    levels: tuple[str, str]
    off: Mapping[str, float]
    speed: str
    law: Callable[[Any, Any], Any]
    viscous: bool
    unit: str


@dataclass(frozen=True)
class Value:
    """One number of machine.yaml: its symbol in the equations, and how far a nominal machine may honestly be off.

    symbol: "" for what the equations do not have, such as a sensor's gain. exact: why nobody doubts it; it then has no
    prior. tolerance: its name among the machine's tolerances. spread: of the nominal value (relative), in the key's own
    unit (absolute), or a factor of ten either way (factor; it needs no tolerance). default: of the largest measured
    input, where an absolute tolerance is not given. free: whether `identify` frees it unless told. in_fit: whether
    `identify` holds it by its tolerance, too. signed: may be negative. with_payload: says nothing in runs without
    payload. scale: what the runs tell of its size where the nominal value is no measure: "input", "input/speed", or a
    number.
    """

    key: str
    symbol: str = ""
    tolerance: str = ""
    spread: Literal["relative", "absolute", "factor"] = "relative"
    default: float = 0.0
    exact: str = ""
    free: bool = False
    in_fit: bool = True
    signed: bool = False
    with_payload: bool = False
    scale: str | float = ""

    def std(self, machine: Any, largest_input: float) -> float:
        """One standard deviation: in the value's own unit, of a factor in its logarithm. 0: nothing is said."""
        if self.spread == "factor":
            return STANDSTILL_LOG_STD
        stated = getattr(machine.tolerances, self.tolerance)
        if self.spread == "absolute":
            return self.default * largest_input if stated is None else float(stated)
        return float(stated) * abs(float(attrgetter(self.key)(machine)))


def parameters_of(values: Iterable[Value], **more: str | float) -> dict[str, str | float]:
    """A plant's parameters: symbol -> key; more: what is no number of machine.yaml."""
    return {value.symbol: value.key for value in values if value.symbol} | more


@dataclass(frozen=True)
class RigidBody:
    """A machine as one rigid body. inertia: at the driven coordinate, kg m^2 or kg. hold: the input that holds its
    load, 0 where it holds none. wave: whether the load goes with the sine of the position."""

    inertia: float
    hold: float
    wave: bool = False


@dataclass(frozen=True)
class NuisancePrior:
    """The small amount of an effect that every machine of a kind has, and that is no gap.

    std(machine, sizes): one standard deviation of it, in the unit of the effect's amounts. fitted: whether it is fitted
    as a base parameter; what has no linear amount, or a phase in each run, is allowed for in the verdict.
    """

    effect: str
    std: Callable[[Any, Sizes], float]
    fitted: bool = True


@dataclass(frozen=True)
class ModelError:
    """What a lumped model of a machine may miss and still be right: standard deviations.

    load: of the transmitted input, or of the largest one (of_largest). inertia: of the input that accelerates.
    standstill: of the friction level, falling with speed over `slow` of the speed scale. time_s: over which it hangs
    together.
    """

    load: float
    inertia: float
    standstill: float
    slow: float
    time_s: float
    of_largest: bool = False


@dataclass(frozen=True)
class CrossCheck:
    """Two signals that say the same thing. ratio: of the one over the other, 1 on a sound log. wrong: what is said
    where it is no machine's; odd: where it is not this machine's, "" for nothing. way: how far either says that the
    run goes, inf where noise does not add up to any."""

    ratio: float
    wrong: str
    odd: str = ""
    way: float = math.inf


@dataclass(frozen=True)
class Table:
    """A measured correction's variable. over, acts_on: as in machine.yaml. of(s, p): its value from the signals at
    the place. turn: it is an angle that comes back after a turn."""

    over: str
    acts_on: str
    of: Callable[[Any, Any], Any]
    turn: bool = False


@dataclass(frozen=True)
class Port:
    """Where a measured correction acts. place: the plant's. unit: N or N m. speed: the signal there that is the
    speed, v or w. sign(s, p): how friction of the correction turns over at standstill, -1 to 1, exact beyond;
    way(s, p): how the machine's own does, of arrays. on_moved: it acts on what moves, else on the driven coordinate.
    share: of a force there that the dead line feels."""

    place: str
    unit: str
    speed: str
    sign: Callable[[Any, Any], Scalar]
    way: Callable[[Any, Any], Array]
    on_moved: bool
    share: float = 0.0


@dataclass(frozen=True)
class Turning:
    """A part that turns. turns_per_displacement: turns over the displacement of what moves, 1/m or 1/rad. folded:
    whether a gap is looked at over its angle: (name, label)."""

    part: str
    turns_per_displacement: Callable[[Any], float]
    folded: tuple[str, str] | None = None


@dataclass(frozen=True)
class DeadLine:
    """The tension of a line that is at rest. force(t, states, p, effects): N, (n,), of the plant's other states
    (n, states). pull_per_input(machine): N per N m of a force on what moves. at_rest(machine, payload_kg): N."""

    signal: str
    force: Callable[[Any, Array, Any, Any], Any]
    pull_per_input: Callable[[Any], float]
    at_rest: Callable[[Any, float], float]


@dataclass(frozen=True)
class Start:
    """Where a run begins, where runs.yaml has to say it. said: what the key means. range(machine): the lowest and the
    highest place, and what the highest is."""

    said: str
    noun: str
    range: Callable[[Any], tuple[float, float, str]]


@dataclass(frozen=True)
class Limits:
    """What a log is checked against. speed, nominal: largest ones that the machine is built for; travel: the lowest,
    the highest place and the length that excess is judged by; empty_mass_kg: without payload. motors: how many share
    the input."""

    nominal_speed: float
    nominal_input: float
    lowest: float
    highest: float
    length: float
    empty_mass_kg: float
    motors: int


@dataclass(frozen=True)
class Sizes:
    """What is large on one machine, SI; sizes["force/speed"] is a quotient of two.

    force: a hoist's weight of the empty carriage, an axis' largest input. torque: of all motors
    together, nominal; an axis' input. speed: of the carriage at nominal motor speed; an axis'
    largest. motor_speed: nominal. length: of the wire's fall; an axis' travel. radius,
    drum_angle: of the drum, and how far it turns for the whole length. mass: of the carriage.
    inertia: of drive and drum at the motor; of an axis.
    """

    kind: str
    force: float
    torque: float
    speed: float
    motor_speed: float
    length: float
    radius: float
    drum_angle: float
    mass: float
    inertia: float

    def __getitem__(self, size: str) -> float:
        """A product of sizes, or one over another. KeyError, with what is wrong, for anything else."""
        over, *under = size.split("/")
        if len(under) > 1:
            below = "*".join(under)
            raise KeyError(f"size '{size}' divides {len(under)} times; expected one quotient, {over}/{below}")
        value = 1.0
        for word in over.split("*"):
            value *= self._one(word)
        for word in under[0].split("*") if under else ():
            value /= self._one(word)
        return value

    def _one(self, word: str) -> float:
        if word == "1":
            return 1.0
        if word not in SIZE_NAMES:
            raise KeyError(f"no size '{word}'; sizes: 1, {', '.join(SIZE_NAMES)}")
        return float(getattr(self, word))


SIZE_NAMES = tuple(name for name in Sizes.__dataclass_fields__ if name != "kind")
UNIT_SIZES = Sizes("", *(1.0 for _ in SIZE_NAMES))  # to try whether an expression of sizes can be evaluated


@dataclass(frozen=True)
class Load:
    """Drive and load as two masses in the direction of the load's motion; forces in N (rotary axis: N m) at the load.

    drive_kg: motors and drum, as felt at the load. mass_kg: what hangs on the wire. stiffness_n_per_m: of all falls
    together, inf for a rigid machine. damping_time_s: damping over stiffness. hold_n: what carries the load, up
    positive. friction_up_n, friction_down_n: magnitudes. force_limit_n: of all motors. hangs: it pulls on a wire, which
    cannot push. top_speed_m_s: what the drive allows, 0 where nothing is stated. Equations: drive_kg a = u - F,
    mass_kg x'' = F - hold - friction with F = stiffness (z + damping_time z'), z the wire's stretch.
    """

    drive_kg: float
    mass_kg: float
    stiffness_n_per_m: float
    damping_time_s: float
    hold_n: float
    friction_up_n: float
    friction_down_n: float
    force_limit_n: float
    hangs: bool = True
    top_speed_m_s: float = 0.0

    @property
    def rigid(self) -> bool:
        return math.isinf(self.stiffness_n_per_m)

    @property
    def angular_frequency_rad_s(self) -> float:
        """Of the load on its wire while the drive moves as asked, undamped."""
        return math.sqrt(self.stiffness_n_per_m / self.mass_kg)

    @property
    def damping(self) -> float:
        """Damping ratio of the same."""
        return 0.0 if self.rigid else 0.5 * self.damping_time_s * self.angular_frequency_rad_s

    def steady_force_n(self, direction: float) -> float:
        """Along an even motion up (+1) or down (-1): weight and friction; negative where the load drives."""
        friction = self.friction_up_n if direction > 0.0 else self.friction_down_n
        return direction * self.hold_n + friction


@dataclass(frozen=True)
class TopSpeed:
    """speed: what moves may go at most, m/s or rad/s; inf where nothing is stated. reason: of a limit beyond it, with
    {limit} for it."""

    speed: float
    reason: str = ""


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """The closed loop of one kind. Functions take the machine's record first.

    position, speed: the plant's signals at the encoder. references: the signals that the controller follows.
    recorded: the signals that a run keeps. rail: the lowest and the highest place of what moves, infinite where
    nothing ends it; top: a place that it never reaches. per_displacement: of the driven coordinate over what
    moves.
    top_speed: of what moves. speed_scale, input_scale: what errors and inputs are judged against, in SI of the
    driven coordinate. inertia(p), load(p, position), friction(p, speed): what a feed-forward knows, of the plant's
    symbols. start: what a start position is, in words. position_loop: whether the controller has one, so that the
    machine knows its place. even_speed: of the driven coordinate, at which the loop is linearised in motion.
    places: of what moves, at which a loop is looked at unless told. drawn: keys of machine.yaml that a study draws
    by their tolerances: what changes the motion, and not the log alone. input_limit: the largest input, inf where
    none is stated; peak_limit: what the metric of the peak is held against; nominal: the same without end, None
    where none is stated; drive_words: the drive in a line; giver: who gives it, in words. swing: what an anti-
    resonance is. where(payload_kg, place): an operating point in words. more_often: (what a family is over, one of
    them), in words. motion_words: hoisting, lowering, at_rest as this kind says them.
    """

    position: str
    speed: str
    references: tuple[str, ...]
    recorded: tuple[str, ...]
    rail: Callable[[Any], tuple[float, float]]
    top: Callable[[Any], float]
    per_displacement: Callable[[Any], float]
    top_speed: Callable[[Any], TopSpeed]
    speed_scale: Callable[[Any], float]
    input_scale: Callable[[Any], float]
    total_inertia: Callable[[Any, float], float]
    even_speed: Callable[[Any], float]
    places: Callable[[Any], tuple[float, ...]]
    start: str
    drawn: tuple[str, ...]
    input_limit: Callable[[Any], float]
    peak_limit: Callable[[Any], float]
    nominal: Callable[[Any], float | None]
    drive_words: Callable[[Any], str]
    giver: str
    swing: str
    where: Callable[[float, float], str]
    more_often: tuple[str, str]
    motion_words: Mapping[str, str]
    position_loop: bool = False
    inertia: Callable[[Any], Scalar] | None = None
    load: Callable[[Any, Scalar], Scalar] | None = None
    friction: Callable[[Any, Scalar], Scalar] | None = None


@dataclass(frozen=True, eq=False)
class Kind:
    """One kind of machine. Functions take its machine record first; `plant` holds its physics.

    noun: what such a machine is called. record: what its machine.yaml holds. example(): one.
    family: names under which effects are declared that suit it, its own first. words: what {n}, {m}, {input}, {up},
    {dn} stand for in names of effects' parameters. reference: (the reference's signal, the signal that follows it).
    transmission: displacement of what moves per displacement of the driven
    coordinate; None where the two are one. nominal_speed: what speeds are judged against; None: the largest
    measured. motor_torque: one motor's nominal torque, N m. weight(machine, payload_kg): of what hangs, N.
    speed_scale: (in words, in one word). sensor: keys of the input's gain and offset.
    values: the numbers of machine.yaml, in the order of a fit's columns. watched: what `watch` estimates of
    each cycle, () for all that is free.
    ties: ((two keys), third): what runs show of the three is two sums only, so the two are held alike in a fit.
    floor: what a machine without a gap leaves: its sensors' noise, or ripple and resonances of its own. nuisances,
    model_error: what a diagnosis allows for besides. load(machine, payload_kg): as references that know their machine
    take it.
    transmitted(p, frame, input, acceleration, payload_kg): of an input, (n,), what goes through to the load, and the
    mass or inertia that moves there. gravity: m/s^2.
    bridged_impacts: whether a diagnosis takes the impacts of a play out of its logs (`simulate/motion.py`), for no law
    of the library has them.
    payload: whether runs carry payloads. closed_loop: what studies, loop and tune ask of the kind; None: they are not
    for it. studies: whether the drawing, the multi-body model, the served plant and exported controllers are for it.
    whole: the subsystem an unnamed gap is laid to, "" where rules tell the parts apart.
    longest_step_s: of fixed steps, that follow the machine (s).
    to_log: signals that one more run could log and a diagnosis weighs, cheapest first. zero_input: why an input of zero
    cannot be.
    """

    name: str
    noun: str
    record: type[Any]
    example: Callable[[], Any]
    plant: Plant
    family: tuple[str, ...]
    words: Mapping[str, str]
    drive: Input
    moved: Moved
    directions: Directions
    signals: SignalSet
    reference: tuple[str, str]
    speed_scale: tuple[str, str]
    sensor: tuple[str, str]
    friction: Friction
    values: tuple[Value, ...]
    sizes: Callable[[Any, Sequence[Run]], Sizes]
    transmitted: Callable[[Any, SimpleNamespace, Array, Array, float], tuple[Array, float]]
    rigid: Callable[[Any, float], RigidBody]
    tables: tuple[Table, ...]
    ports: Mapping[str, Port]
    floor: Literal["sensors", "own"]
    nuisances: tuple[NuisancePrior, ...]
    model_error: ModelError
    whole: str
    transmission: Callable[[Any], float] | None = None
    nominal_speed: Callable[[Any], float] | None = None
    motor_torque: Callable[[Any], float] | None = None
    watched: tuple[str, ...] = ()
    ties: tuple[tuple[tuple[str, str], str], ...] = ()
    bridged_impacts: bool = False
    payload: bool = False
    studies: bool = False
    closed_loop: ClosedLoop | None = None
    start: Start | None = None
    limits: Callable[[Any], Limits] | None = None
    load: Callable[[Any, float], Load | None] | None = None
    weight: Callable[[Any, float], float] | None = None
    gravity: Callable[[Any], float] = lambda machine: STANDARD_GRAVITY
    dead_line: DeadLine | None = None
    turning: tuple[Turning, ...] = ()
    longest_step_s: Callable[[Any], float] = lambda machine: math.inf
    to_log: tuple[str, ...] = ()
    zero_input: str = ""
    cross_checks: Callable[..., Iterator[CrossCheck]] | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        from workbench.machines.kinds import kind_named

        return kind_named, (self.name,)

    @property
    def looped(self) -> ClosedLoop:
        """The closed loop of a kind that has one."""
        assert self.closed_loop is not None
        return self.closed_loop

    @property
    def holds_load(self) -> bool:
        """Whether the input always holds a load: then the load says which signal is upside down."""
        return bool(self.zero_input)

    @property
    def inputs(self) -> tuple[str, ...]:
        """The input's parts, then the input itself."""
        return (*self.drive.parts, self.plant.input)

    @property
    def can_clip(self) -> tuple[str, ...]:
        """Signals of forces and torques, which saturate."""
        return (*self.inputs, *((self.dead_line.signal,) if self.dead_line is not None else ()))

    @property
    def symbols(self) -> dict[str, str]:
        """Key of machine.yaml -> its symbol in the plant."""
        return {key: symbol for symbol, key in self.plant.parameters.items() if isinstance(key, str)}

    def transmission_of(self, machine: Any) -> float:
        """Displacement of what moves per displacement of the driven coordinate, m/rad; 1 where the two are one."""
        return 1.0 if self.transmission is None else self.transmission(machine)

    def sensor_of(self, machine: Any) -> tuple[float, float]:
        """gain, offset of the logged input: logged = gain * true + offset."""
        gain, offset = (attrgetter(key)(machine) for key in self.sensor)
        return float(gain), float(offset)

    def place_of(self, machine: Any, start_position: float, position: Array) -> Array:
        """(n,) where what moves is, m or rad, from the driven coordinate's (n,): on a wire that does not stretch."""
        if self.moved.placed_by_log:
            return position
        return start_position + (position - position[0]) * self.transmission_of(machine)

    def largest_input(self, runs: Sequence[Run]) -> float:
        """Of all runs, in the input's unit."""
        return max(float(np.max(np.abs(run[self.plant.input]))) for run in runs)

    @property
    def base(self) -> tuple[Value, ...]:
        """What a nominal machine may be off by: the base parameters of a fit and of a diagnosis."""
        return tuple(value for value in self.values if not value.exact)

    @property
    def free(self) -> tuple[str, ...]:
        """What `identify` frees unless told."""
        return tuple(value.key for value in self.values if value.free)

    def value(self, key: str) -> Value | None:
        """The value of that key, if it is declared."""
        return next((value for value in self.values if value.key == key), None)

    def base_value(self, key: str) -> Value | None:
        """The value of that key, if it may be off."""
        return next((value for value in self.base if value.key == key), None)

    def frame(self, run: Run, position: Array, speed: Array, states: Array, p: Any) -> SimpleNamespace:
        """The signals that tables are over, along a driven run: v, x of what moves; w, angle of the driven
        coordinate; t; start_time_s is the run's. states: (n, others), as `InverseSimulation.predict` gives them."""
        plant = self.plant
        names = (*plant.positions[1:], *plant.speeds[1:])
        others = dict(zip(names, states.T[: len(names)], strict=True))  # the effects' memory stands behind
        if self.moved.placed_by_log:
            return SimpleNamespace(t=run.time_s, x=position, v=speed, angle=position, w=speed)
        first = plant.start_of(run.start_position_m, float(speed[0]), p)[0][0]
        return SimpleNamespace(
            t=run.time_s,
            x=others[plant.positions[plant.placed]],
            v=others[plant.speeds[plant.placed]],
            angle=first + position - position[0],
            w=speed,
        )
