"""An OPC UA server's values: which nodes are which signals, and a subscription for ever that cuts and writes cycles."""

from __future__ import annotations

import asyncio
import logging
import math
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from queue import SimpleQueue
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from workbench.core.errors import InputError, nearest
from workbench.core.record import Finite, Payload, Position, Record, long_form
from workbench.core.yaml_strict import load, validate
from workbench.machines import TIME, Axis, Hoist, Kind, kind_of
from workbench.watch.stream import TRIGGER, Cut, CutRules, Cutter, Logs, on_grid, start_value, with_payload

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
    fixed: payload_kg and start_position_m where no node says them."""

    nodes: Mapping[str, Node]
    motion: str
    is_position: bool
    fixed: Mapping[str, float]

    @property
    def signals(self) -> tuple[str, ...]:
        """What goes into a log."""
        return tuple(name for name in self.nodes if name not in (PAYLOAD, TRIGGER))


def height_signal(kind: Kind) -> str:
    """The signal that says where the machine is."""
    return kind.plant.positions[kind.plant.placed]


def nodes_of(file: Path | None, machine: Hoist | Axis) -> Nodes:
    """InputError where a signal is unknown, or one that is needed has no node."""
    kind = kind_of(machine)
    made = served_nodes(kind) if file is None else validate(NodesFile, load(file))
    wanted = [name for name in kind.signals.names if name != TIME]
    known = [*wanted, *([PAYLOAD] if kind.payload else [])]
    for name in made.nodes:
        if name not in known:
            raise InputError(f"unknown signal '{name}'; {nearest(name, known)}", file=file, place="nodes")
    for group in kind.signals.needed:
        ways = [[name for name in way if name != TIME] for way in group]
        if not any(all(name in made.nodes for name in way) for way in ways):
            needs = " or ".join(" and ".join(way) for way in ways)
            raise InputError(f"has no node for {needs}", file=file, place="nodes")
    fixed = {}
    if kind.payload and PAYLOAD not in made.nodes:
        if made.payload_kg is None:
            raise InputError("needs a node for payload_kg, or payload_kg itself", file=file, place=PAYLOAD)
        fixed[PAYLOAD] = made.payload_kg
    if kind.start is not None and height_signal(kind) not in made.nodes:
        if made.start_position_m is None:
            text = f"needs a node for {height_signal(kind)}, or start_position_m where all cycles begin"
            raise InputError(text, file=file, place="start_position_m")
        fixed["start_position_m"] = made.start_position_m
    position, speed = kind.plant.positions[0], kind.plant.speeds[0]
    nodes = dict(made.nodes) | ({TRIGGER: Node(node=made.trigger)} if made.trigger is not None else {})
    return Nodes(nodes, speed if speed in nodes else position, speed not in nodes, fixed)


def served_nodes(kind: Kind) -> NodesFile:
    """Those of a plant that `workbench serve --protocol opcua` serves."""
    shown = {signal.name for signal in kind.plant.signals}
    nodes = {name: Node(node=f"{SERVED}{name}") for name in kind.signals.names if name in shown}
    nodes[kind.plant.input] = Node(node=f"{SERVED}{kind.drive.quantity}_at_work_{kind.drive.suffix}")
    if kind.payload:
        nodes[PAYLOAD] = Node(node=f"{SERVED}payload_now_kg")
    return NodesFile(nodes=nodes)


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


def still_speed(machine: Hoist | Axis, given: float | None) -> float:
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

    def __init__(self, address: str, nodes: Nodes, rules: CutRules, machine: Hoist | Axis, folder: Path,
                 every_s: float, clock: Callable[[], float] = time.monotonic) -> None:  # fmt: skip
        """every_s: how often the server samples. clock: of the arrivals, steady. InputError: the extra is missing."""
        try:
            import asyncua  # noqa: F401
        except ImportError as error:
            raise InputError("a stream needs the extra 'serve': pip install '.[serve]'", place=address) from error
        self.address, self.notes = address, SimpleQueue[Note]()
        self._nodes, self._rules, self._kind, self._every_s = nodes, rules, kind_of(machine), every_s
        self._cutter, self._logs, self._clock = Cutter(rules), Logs(folder), clock
        self._stop, self._begun = threading.Event(), threading.Event()
        self._failed: InputError | None = None
        self._connected = self._full = False
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
            known = {node.nodeid: told for node, told in zip(nodes, self._nodes.nodes.items(), strict=True)}
            handler = _Handler(self._cutter, self._clock, known)
            kept = {"queue_maxsize": 10 * QUEUE, "overflow": OverflowPolicy.DROP_OLDEST}
            subscription = await client.create_subscription(1e3 * max(self._every_s, TICK_S), handler, **kept)
            every_ms = 1e3 * self._every_s
            await subscription.subscribe_data_change(nodes, queuesize=QUEUE, sampling_interval=every_ms)
            self._connected = True
            if lost:
                self.notes.put(Note(f"{self.address}: the line is back"))
            self._begun.set()
            while not self._stop.is_set():
                await asyncio.sleep(TICK_S)
                await client.check_connection()
                if handler.lost:
                    raise ConnectionError(f"the server ended the subscription: {handler.lost}")
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

    # What the cutter made.

    def _write(self) -> None:
        cutter = self._cutter
        while cutter.spoilt:
            bad = cutter.spoilt.popleft()
            when = _when(bad.at_s)
            if bad.in_cycle:
                self.notes.put(Note(bad.reason, f"the cycle at {when}", f"stream {bad.at_s!r}"))
            else:
                self.notes.put(Note(f"{self.address}: {bad.reason}, at {when}"))
        while cutter.cycles:
            cut = cutter.cycles[0]
            try:
                self._log(cut)
            except InputError as error:
                self.notes.put(Note(str(error), f"the cycle at {_when(cut.begin_s)}", f"stream {cut.begin_s!r}"))
            except OSError as error:  # it waits for room
                if not self._full:
                    reason = f"a cycle cannot be written: {error.strerror or error}; it is tried again"
                    self.notes.put(Note(f"{self._logs.folder}: {reason}"))
                self._full = True
                return
            cutter.cycles.popleft()
            self._full = False

    def _log(self, cut: Cut) -> None:
        nodes = self._nodes
        said = dict(nodes.fixed)
        if PAYLOAD in nodes.nodes:
            cut, said[PAYLOAD] = with_payload(cut, PAYLOAD)
        if self._kind.start is not None and "start_position_m" not in said:
            said["start_position_m"] = start_value(cut, height_signal(self._kind))
            if not math.isfinite(said["start_position_m"]):
                raise InputError(f"{height_signal(self._kind)} was no number when it began")
        time_s, signals = on_grid(cut, nodes.motion)
        self._logs.write(cut.begin_s, time_s, {name: signals[name] for name in nodes.signals if name in signals}, said)


def line_of(
    address: str, nodes: Path | None, machine: Hoist | Axis, folder: Path, every_s: float, still: float | None,
    stand_s: float, silent_s: float, *, once: bool,
) -> Line:  # fmt: skip
    """The line that a command asks for. InputError for what cannot be."""
    if once:
        raise InputError("a stream has no end; it is watched until it is stopped, or for a stated time", place="once")
    which = nodes_of(nodes, machine)
    speed = still_speed(machine, still)
    rules = CutRules(which.motion, speed, which.is_position, stand_s, silent_s, triggered=TRIGGER in which.nodes)
    return Line(address, which, rules, machine, folder, every_s)


class _Handler:
    """Hands on what the server tells."""

    def __init__(self, cutter: Cutter, clock: Callable[[], float], signals: Mapping[Any, tuple[str, Node]]) -> None:
        self._cutter, self._clock, self._signals = cutter, clock, signals
        self.lost = ""

    def datachange_notification(self, node: Any, value: Any, data: Any) -> None:
        name, how = self._signals[node.nodeid]
        told = data.monitored_item.Value
        stamp = told.SourceTimestamp or told.ServerTimestamp or datetime.now(UTC)
        good = told.StatusCode is None or told.StatusCode.is_good()
        number = how.scale * float(value) + how.offset if good and isinstance(value, int | float) else math.nan
        utc = stamp if stamp.tzinfo else stamp.replace(tzinfo=UTC)  # as OPC UA's times are
        self._cutter.add(name, utc.timestamp(), number, self._clock())

    def status_change_notification(self, status: Any) -> None:
        """The server has given the subscription up."""
        self.lost = str(status)


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
