"""An OPC UA server's values: which nodes are which signals, and a subscription for ever that cuts and writes cycles."""

from __future__ import annotations

import asyncio
import logging
import math
import threading
import time
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from operator import itemgetter
from pathlib import Path
from queue import SimpleQueue
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from workbench.core.errors import InputError, UnwritableError, check_known, nearest
from workbench.core.record import Finite, Payload, Position, Record, long_form
from workbench.core.run import Array
from workbench.core.whole_folder import whole_file, writable
from workbench.core.yaml_strict import load, validate
from workbench.machines import TIME, Machine, kind_of

TRIGGER = "trigger"
MOST_LEAD_S = 1.0  # of standing that a cycle keeps on either side
LONGEST_S = 3600.0  # a cycle that lasts longer is none
DRIFT = 1e-3  # of two clocks against each other
SPEED_OVER_S = 0.1  # over which a position's change is a speed
FEWEST = 20  # samples of a cycle that is worth a log
SAME_PAYLOAD_KG = 10.0
ORIGIN = "began.txt"  # when the first cycle of all began, on the source's clock
_TIME = itemgetter(0)


@dataclass(frozen=True)
class CutRules:
    """motion: the signal that says whether the machine moves; is_position: it is a position, and its change counts.

    still: speeds up to it are standing, in the signal's unit (a position's: per second). stand_s: a rest so long ends
    a cycle. silent_s: no value for so long while the machine moves is a stream that has stopped. slip_s: a clock
    that differs by less from the arrivals' has not jumped. triggered: a trigger marks the cycles instead.
    """

    motion: str
    still: float
    is_position: bool = False
    stand_s: float = 2.0
    silent_s: float = 2.0
    slip_s: float = 1.0
    triggered: bool = False


@dataclass(frozen=True)
class Cut:
    """One cycle on the source's clock. moves_s: its first and its last motion. series: (n, 2) times and values of each
    signal; the first time may lie before begin_s: that value holds until the next."""

    begin_s: float
    end_s: float
    moves_s: tuple[float, float]
    series: Mapping[str, Array]

    def times_and_values(self, name: str) -> tuple[Array, Array]:
        t, v = self.series.get(name, np.zeros((0, 2))).T
        return t, v

    def value(self, name: str, at_s: float) -> float:
        """What a signal held then; its first value where it came later, NaN where there is none."""
        t, v = self.times_and_values(name)
        return float(v[max(int(np.searchsorted(t, at_s, "right")) - 1, 0)]) if len(v) else math.nan


@dataclass(frozen=True)
class Spoilt:
    """A cycle that does not count, or a note. at_s: on the source's clock."""

    at_s: float
    reason: str
    in_cycle: bool


class Cutter:
    """Values in, cycles out; `cycles` and `spoilt` are emptied by who reads them."""

    def __init__(self, rules: CutRules) -> None:
        self.rules = rules
        self.cycles: deque[Cut] = deque()
        self.spoilt: deque[Spoilt] = deque()
        lead, stand = min(MOST_LEAD_S, 0.5 * rules.stand_s), rules.stand_s
        # What marks a cycle is above `still` in it. It begins after a rest of `stand`, and is cut when one of `wait`
        # has passed: all that belongs to it has had the time to come.
        by_motion, by_trigger = (rules.motion, rules.still, stand, lead, stand), (TRIGGER, 0.0, 0.0, 0.0, lead)
        marks = by_trigger if rules.triggered else by_motion
        self._marker, self._still, self._stand, self._lead, self._wait = marks
        self._clear()

    def _clear(self) -> None:
        self._series: dict[str, list[tuple[float, float]]] = {}
        self._latest = -math.inf  # of the source's clock
        self._arrived = -math.inf  # when that value came
        self._prompt = -math.inf  # the source's clock less the arrival's, of the promptest value
        self._began: float | None = None  # the cycle under way
        self._rests: float | None = None  # since when
        self._moved = -math.inf

    @property
    def in_cycle(self) -> bool:
        return self._began is not None

    def _moves(self, now: float) -> bool:
        """In a cycle, and not at rest."""
        return self._began is not None and (self._rests is None or now - self._moved <= self._lead)

    def add(self, signal: str, t: float, value: float, arrived_s: float) -> None:
        """A value of a signal (or of TRIGGER) at time t of its source, NaN where it is bad."""
        last = self._series[signal][-1][0] if signal in self._series else -math.inf
        if not self._clock_jumps(t, last, arrived_s) and t <= last:  # come again, or out of order
            return
        if t - self._latest > self.rules.silent_s and self._moves(t):
            self._spoil(f"no value came for {t - self._latest:.1f} s while the machine moved")
            self._begin_anew(t)
        self._series.setdefault(signal, []).append((t, value))
        if t >= self._latest:
            self._latest, self._arrived = t, arrived_s
        if signal == self._marker and math.isfinite(value):
            if self._speed(t, value) <= self._still:
                self._rests = t if self._rests is None else self._rests
            else:
                rested = self._rests is not None and t - self._rests >= self._stand
                if rested and self._began is not None:
                    self._cut()
                if rested:
                    self._began = t - self._lead
                self._rests, self._moved = None, t

    def tick(self, arrived_s: float) -> None:
        """All that has come so far is in: ends a cycle, and forgets. Without values time goes on: nothing has changed
        since, or the stream has stopped."""
        if self._latest == -math.inf:
            return
        quiet = arrived_s - self._arrived
        now = self._latest + quiet
        if self._began is not None and now - self._began > LONGEST_S:
            self._spoil(f"it lasted longer than {LONGEST_S:g} s")
        elif self._moves(now) and quiet > self.rules.silent_s:
            self._spoil(f"no value came for {self.rules.silent_s:g} s while the machine moved")
        elif self._began is not None and self._rests is not None and now - self._rests >= self._wait:
            self._cut()
        if self._began is None:
            for kept in self._series.values():
                before = bisect_right(kept, now - self.rules.stand_s - MOST_LEAD_S, key=_TIME)
                del kept[: max(before - 1, 0)]

    def broken(self, reason: str) -> None:
        """The line is lost: a cycle that is under way does not count, and standing has to be seen again."""
        if self._began is not None:
            self._spoil(reason)
        self._clear()

    def _clock_jumps(self, t: float, last: float, arrived_s: float) -> bool:
        """A line delays, and never hurries: a value that is ahead of the promptest one has another clock."""
        if last == -math.inf:  # a server first tells what it has, which may be old
            return False
        offset = t - arrived_s
        prompt = self._prompt - DRIFT * max(arrived_s - self._arrived, 0.0)
        ahead = offset - prompt if prompt > -math.inf else 0.0
        self._prompt = max(prompt, offset)
        back = last - t > self.rules.slip_s and self._latest - t > self.rules.slip_s
        if not back and ahead <= self.rules.slip_s:
            return False
        way = f"back by {self._latest - t:.1f} s" if back else f"ahead by {ahead:.1f} s"
        self._spoil(f"the clock of the source jumped {way}")
        self._begin_anew(t)
        self._prompt = offset
        return True

    def _begin_anew(self, t: float) -> None:
        """From t on, with what each signal held before: a value that does not change does not come again."""
        held = {name: series[-1][1] for name, series in self._series.items()}
        self._clear()
        self._series = {name: [(-math.inf, value)] for name, value in held.items()}
        if self.rules.triggered or not self.rules.is_position:
            self._rests = t if abs(held.get(self._marker, math.nan)) <= self._still else None

    def _spoil(self, reason: str) -> None:
        self.spoilt.append(Spoilt(self._latest, reason, self._began is not None))
        self._began = self._rests = None
        self._moved = self._latest

    def _speed(self, t: float, value: float) -> float:
        """Of the marker; a trigger's is its value."""
        if self.rules.triggered or not self.rules.is_position:
            return abs(value)
        series = self._series[self._marker]
        before = bisect_right(series, t - SPEED_OVER_S, key=_TIME) - 1
        way = abs(value - series[before][1]) / (t - series[before][0]) if before >= 0 else 0.0
        return way if math.isfinite(way) else 0.0

    def _cut(self) -> None:
        """The cycle under way is whole."""
        assert self._began is not None and self._rests is not None
        end = self._rests if self.rules.triggered else self._moved + self._lead
        moves = self._began + self._lead, end - self._lead
        series = {name: _between(kept, self._began, end) for name, kept in self._series.items() if name != TRIGGER}
        came = {name: kept for name, kept in series.items() if len(kept)}
        self.cycles.append(Cut(self._began, end, moves, came))
        self._began = None


def _between(series: list[tuple[float, float]], begin: float, end: float) -> Array:
    """(n, 2) from what held at `begin`."""
    first = max(bisect_right(series, begin, key=_TIME) - 1, 0)
    kept: Array = np.array(series[first : bisect_right(series, end, key=_TIME)], dtype=float).reshape(-1, 2)
    kept[:1, 0] = np.maximum(kept[:1, 0], begin)
    return kept


def on_grid(cut: Cut, motion: str) -> tuple[Array, dict[str, Array]]:
    """(n,) times from 0 and (n,) values of each signal, NaN where the source said so.

    The step is the median one of the signal `motion`. Between two values that came one step apart lies a straight
    line; a value that did not come again held until a step before the next one. InputError for too few values.
    """
    times, _ = cut.times_and_values(motion)
    inside = times[(times >= cut.begin_s) & (times <= cut.end_s)]
    if len(inside) < FEWEST:
        raise InputError(f"{len(inside)} values of {motion} came within {cut.end_s - cut.begin_s:.1f} s")
    step = float(np.median(np.diff(inside)))
    count = int((cut.end_s - cut.begin_s) / step) + 1
    grid: Array = np.asarray(cut.begin_s + step * np.arange(count), dtype=float)
    signals = {}
    for name in cut.series:
        t, v = cut.times_and_values(name)
        late = np.flatnonzero(np.diff(t) > 1.5 * step)
        t, v = np.insert(t, late + 1, t[late + 1] - step), np.insert(v, late + 1, v[late])
        signals[name] = np.asarray(np.interp(grid, t, v, left=math.nan))
    return grid - cut.begin_s, signals


def with_payload(cut: Cut, name: str) -> tuple[Cut, float]:
    """The cycle from where its payload has been picked up, and that payload, kg.

    InputError where the payload changes while the machine moves, or is no payload.
    """
    t, v = cut.times_and_values(name)
    first, last = cut.moves_s
    payload = cut.value(name, first) if len(t) and t[0] <= first else math.nan
    carried = np.array([payload, *v[(first < t) & (t < last)]])
    if not np.all(np.isfinite(carried) & (carried >= 0.0)):
        raise InputError(f"{name} is {min(carried):g}, expected kg, 0 or more")
    if np.ptp(carried) > SAME_PAYLOAD_KG:
        raise InputError(f"{name} changed from {carried[0]:g} to {carried[-1]:g} kg within it")
    others = t[np.abs(v - payload) > SAME_PAYLOAD_KG]
    picked_up = t[t > max(others[others < first], default=-math.inf)][0]
    set_down = min(others[others > last], default=math.inf)
    begin, end = max(cut.begin_s, float(picked_up)), min(cut.end_s, float(set_down))
    return replace(cut, begin_s=begin, end_s=end), payload


class Logs:
    """A folder that cycles are written to: `cycle_DATE.csv` and what is said of it, each whole or not at all."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        with writable(folder):
            folder.mkdir(parents=True, exist_ok=True)
        file = folder / ORIGIN
        self._origin = float(file.read_text(encoding="utf-8")) if file.is_file() else None

    def write(self, begin_s: float, time_s: Array, signals: Mapping[str, Array], said: Mapping[str, float]) -> Path:
        """said: payload_kg and start_position_m, of kinds that have them. UnwritableError on a full disk."""
        if self._origin is None:
            self._write(ORIGIN, repr(begin_s))
            self._origin = begin_s
        stamp = datetime.fromtimestamp(begin_s, UTC).strftime("%Y-%m-%d_%H-%M-%S.%f")[:-3]
        name, k = f"cycle_{stamp}.csv", 1
        while (self.folder / name).exists():  # a clock that was set back
            name, k = f"cycle_{stamp}_{k}.csv", k + 1
        said = {**said, "start_time_s": round(begin_s - self._origin, 6)}
        self._write(f"{name}.yaml", "".join(f"{key}: {value!r}\n" for key, value in said.items()))
        head = ",".join(("time_s", *signals))
        rows = np.column_stack([time_s, *signals.values()]).tolist()
        lines = [",".join("" if math.isnan(value) else f"{value:.10g}" for value in row) for row in rows]
        self._write(name, "\n".join((head, *lines, "")))
        return self.folder / name

    def _write(self, name: str, text: str) -> None:
        with whole_file(self.folder / name) as part:
            part.write_text(text, encoding="utf-8")


PAYLOAD = "payload_kg"
SERVED = "nsu=urn:workbench:plant;s=Plant.Outputs."


class Node(Record):
    """signal = scale · value + offset"""

    node: Annotated[str, Field(min_length=1)]
    scale: Finite = 1.0
    offset: Finite = 0.0


class NodesFile(Record):
    """nodes.yaml. payload_kg, start_position_m: where no node says them."""

    format: Literal[1] = 1
    nodes: Annotated[dict[str, Node], Field(min_length=1)]
    trigger: Annotated[str, Field(min_length=1)] | None = None
    payload_kg: Payload | None = None
    start_position_m: Position | None = None

    @model_validator(mode="before")
    @classmethod
    def _short_nodes(cls, data: object) -> object:
        return long_form(data, "nodes", "node")


@dataclass(frozen=True)
class Nodes:
    """nodes: by signal, the payload and TRIGGER among them. motion: the signal that says whether the machine moves.
    height: the one that says where it is. fixed: payload_kg and start_position_m where no node says them."""

    nodes: Mapping[str, Node]
    motion: str
    is_position: bool
    height: str
    fixed: Mapping[str, float]


def nodes_of(file: Path | None, machine: Machine) -> Nodes:
    """Without a file: those of a plant that `workbench serve --protocol opcua` serves. InputError where a signal is
    unknown, or one that is needed has no node."""
    kind = kind_of(machine)
    plant, wanted = kind.plant, [name for name in kind.signals.names if name != TIME]
    if file is None:
        shown = {signal.name: signal.name for signal in plant.signals if signal.name in wanted}
        shown[plant.input] = f"{kind.drive.quantity}_at_work_{kind.drive.suffix}"
        shown |= {PAYLOAD: "payload_now_kg"} if kind.payload else {}
        made = NodesFile(nodes={name: Node(node=f"{SERVED}{served}") for name, served in shown.items()})
    else:
        made = validate(NodesFile, load(file))
    known = [*wanted, *([PAYLOAD] if kind.payload else [])]
    for name in made.nodes:
        check_known("unknown signal", name, known, file=file, place="nodes")
    for group in kind.signals.needed:
        ways = [[name for name in way if name != TIME] for way in group]
        if not any(all(name in made.nodes for name in way) for way in ways):
            needs = " or ".join(" and ".join(way) for way in ways)
            raise InputError(f"has no node for {needs}", file=file, place="nodes")
    fixed, height = {}, plant.positions[plant.placed]
    if kind.payload and PAYLOAD not in made.nodes:
        if made.payload_kg is None:
            raise InputError("needs a node for payload_kg, or payload_kg itself", file=file, place=PAYLOAD)
        fixed[PAYLOAD] = made.payload_kg
    if kind.start is not None and height not in made.nodes:
        if made.start_position_m is None:
            text = f"needs a node for {height}, or start_position_m where all cycles begin"
            raise InputError(text, file=file, place="start_position_m")
        fixed["start_position_m"] = made.start_position_m
    position, speed = plant.positions[0], plant.speeds[0]
    nodes = dict(made.nodes) | ({TRIGGER: Node(node=made.trigger)} if made.trigger is not None else {})
    return Nodes(nodes, speed if speed in nodes else position, speed not in nodes, height, fixed)


SCHEME = "opc.tcp://"
ANSWER_S = 4.0  # a server that takes longer is not there
RETRY_S = (0.5, 30.0)  # first and longest pause before the line is tried again
TICK_S = 0.1
QUEUE = 10_000  # values of a node that the server keeps between two messages
STILL = 0.005  # of the nominal speed
MOST_NAMED = 2000  # nodes that are looked at for the nearest name


@dataclass(frozen=True)
class Note:
    """What is to be said of the stream. key, name: of a cycle that does not count, "" for anything else."""

    text: str
    name: str = ""
    key: str = ""


def still_speed(machine: Machine, given: float | None) -> float:
    """Up to which speed a machine stands, in its motion signal's unit. InputError where nothing says it."""
    if given is not None:
        return given
    kind = kind_of(machine)
    if kind.nominal_speed is None:
        text = f"needs a speed up to which the machine stands, in {kind.moved.speed_unit}: machine.yaml of kind "
        raise InputError(f"{text}'{machine.kind}' names no speed", place="still")
    return STILL * kind.nominal_speed(machine)


class Line:
    """The subscription in a thread of its own. Logs go to a folder, notes to a queue."""

    def __init__(self, address: str, nodes: Nodes, rules: CutRules, machine: Machine, folder: Path,
                 every_s: float, clock: Callable[[], float] = time.monotonic) -> None:  # fmt: skip
        """every_s: how often the server samples. clock: of the arrivals, steady. InputError: the extra is missing."""
        try:
            import asyncua  # noqa: F401
        except ImportError as error:
            raise InputError("a stream needs the extra 'serve': pip install '.[serve]'", place=address) from error
        self.address, self.notes = address, SimpleQueue[Note]()
        self._nodes, self._starts, self._every_s = nodes, kind_of(machine).start is not None, every_s
        self._cutter, self._logs, self._clock = Cutter(rules), Logs(folder), clock
        self._stop, self._begun = threading.Event(), threading.Event()
        self._failed: InputError | None = None
        self._connected = self._full = False
        self._signals: dict[Any, tuple[str, Node]] = {}  # by the node's id
        self._ended = ""  # what the server said when it gave the subscription up
        self._thread = threading.Thread(target=lambda: asyncio.run(self._run()), name="stream", daemon=True)

    def start(self) -> None:
        """InputError where no server answers, or it has not the nodes. Later on the line is tried again and again."""
        self._thread.start()
        self._begun.wait()
        if self._failed is not None:
            raise self._failed

    @property
    def in_cycle(self) -> bool:
        """Whether a cycle is under way."""
        return self._cutter.in_cycle

    def close(self) -> None:
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(2.0 * ANSWER_S)

    async def _run(self) -> None:
        from asyncua import ua

        logging.getLogger("asyncua").setLevel(logging.CRITICAL)
        pause, lost = RETRY_S[0], ""
        while not self._stop.is_set():
            try:
                await self._listen(lost)
            except InputError as error:
                if not self._begun.is_set():
                    self._failed = error
                    break
                lost = str(error)
            except (OSError, ua.UaError, TimeoutError, asyncio.CancelledError) as error:
                lost = f"{type(error).__name__} {error}".strip()
                if not self._begun.is_set():
                    self._failed = InputError(f"no server answers: {lost}", place=self.address)
                    break
            if self._connected:
                self._connected, pause = False, RETRY_S[0]
                self._cutter.broken("the line to the server was lost")
                self._write()
                self.notes.put(Note(f"{self.address}: the line is lost ({lost}); it is tried again"))
            await asyncio.sleep(0.0 if self._stop.is_set() else pause)
            pause = min(2.0 * pause, RETRY_S[1])
        self._begun.set()

    async def _listen(self, lost: str) -> None:
        """Until the line is lost, or somebody stops it."""
        from asyncua import Client
        from asyncua.common.subscription import OverflowPolicy

        async with Client(self.address, timeout=ANSWER_S) as client:
            nodes = [await self._node(client, name, wanted) for name, wanted in self._nodes.nodes.items()]
            told = zip(nodes, self._nodes.nodes.items(), strict=True)
            self._signals, self._ended = {node.nodeid: signal for node, signal in told}, ""
            kept = {"queue_maxsize": 10 * QUEUE, "overflow": OverflowPolicy.DROP_OLDEST}
            subscription = await client.create_subscription(1e3 * max(self._every_s, TICK_S), self, **kept)
            every_ms = 1e3 * self._every_s
            await subscription.subscribe_data_change(nodes, queuesize=QUEUE, sampling_interval=every_ms)
            self._connected = True
            if lost:
                self.notes.put(Note(f"{self.address}: the line is back"))
            self._begun.set()
            while not self._stop.is_set():
                await asyncio.sleep(TICK_S)
                await client.check_connection()
                if self._ended:
                    raise ConnectionError(f"the server ended the subscription: {self._ended}")
                self._cutter.tick(self._clock())
                self._write()

    async def _node(self, client: Any, name: str, wanted: Node) -> Any:
        """InputError for one that the server does not have, or that is no number."""
        from asyncua import ua

        place = f"{self.address}: {name}"
        text = wanted.node
        try:
            if text.startswith("nsu="):
                uri, _, rest = text[4:].partition(";")
                spaces = await client.get_namespace_array()
                if uri not in spaces:
                    raise InputError(f"the server has no namespace '{uri}'; name its nodes in a nodes.yaml",
                                     place=place)  # fmt: skip
                text = f"ns={spaces.index(uri)};{rest}"
            node = client.get_node(text)
            value = await node.read_value()
        except ua.UaStatusCodeError as error:
            if error.code not in (ua.StatusCodes.BadNodeIdUnknown, ua.StatusCodes.BadNodeIdInvalid):
                if error.code == ua.StatusCodes.BadWaitingForInitialData:
                    return node
                raise InputError(f"node '{text}' cannot be read: {error}", place=place) from error
            names = await _names(client)
            raise InputError(f"the server has no node '{text}'; {nearest(text, names)}", place=place) from error
        except (ua.UaStringParsingError, ValueError) as error:
            raise InputError(f"'{text}' is no node, expected such as ns=2;s=Drive.Speed", place=place) from error
        if not isinstance(value, int | float):
            raise InputError(f"node '{text}' holds {value!r}, expected a number", place=place)
        return node

    # What asyncua calls.

    def datachange_notification(self, node: Any, value: Any, data: Any) -> None:
        name, how = self._signals[node.nodeid]
        told = data.monitored_item.Value
        stamp = told.SourceTimestamp or told.ServerTimestamp or datetime.now(UTC)
        good = told.StatusCode is None or told.StatusCode.is_good()
        number = how.scale * float(value) + how.offset if good and isinstance(value, int | float) else math.nan
        utc = stamp if stamp.tzinfo else stamp.replace(tzinfo=UTC)  # as OPC UA's times are
        self._cutter.add(name, utc.timestamp(), number, self._clock())

    def status_change_notification(self, status: Any) -> None:
        self._ended = str(status)

    # What the cutter made.

    def _write(self) -> None:
        cutter = self._cutter
        while cutter.spoilt:
            bad = cutter.spoilt.popleft()
            when = _when(bad.at_s)
            cycle = Note(bad.reason, f"the cycle at {when}", f"stream {bad.at_s!r}")
            self.notes.put(cycle if bad.in_cycle else Note(f"{self.address}: {bad.reason}, at {when}"))
        while cutter.cycles:
            cut = cutter.cycles[0]
            try:
                self._log(cut)
            except UnwritableError as error:  # it waits for room
                if not self._full:
                    self.notes.put(Note(f"{error}; a cycle waits, and it is tried again"))
                self._full = True
                return
            except InputError as error:
                self.notes.put(Note(str(error), f"the cycle at {_when(cut.begin_s)}", f"stream {cut.begin_s!r}"))
            cutter.cycles.popleft()
            self._full = False

    def _log(self, cut: Cut) -> None:
        nodes = self._nodes
        said = dict(nodes.fixed)
        if PAYLOAD in nodes.nodes:
            cut, said[PAYLOAD] = with_payload(cut, PAYLOAD)
        if self._starts and "start_position_m" not in said:
            said["start_position_m"] = cut.value(nodes.height, cut.begin_s)
            if not math.isfinite(said["start_position_m"]):
                raise InputError(f"{nodes.height} was no number when it began")
        time_s, signals = on_grid(cut, nodes.motion)
        logged = {name: signals[name] for name in nodes.nodes if name in signals and name != PAYLOAD}
        self._logs.write(cut.begin_s, time_s, logged, said)


def _when(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M:%S UTC") if seconds > 0.0 else "its beginning"


async def _names(client: Any) -> list[str]:
    """Nodes of the server that hold values, by their ids; not the standard's own."""
    from asyncua import ua

    todo, names = [client.nodes.objects], []
    for _ in range(MOST_NAMED):
        if not todo:
            break
        for child in await todo.pop(0).get_children():
            if child.nodeid.NamespaceIndex == 0:
                continue
            if await child.read_node_class() == ua.NodeClass.Variable:
                names.append(child.nodeid.to_string())
            else:
                todo.append(child)
    return names
