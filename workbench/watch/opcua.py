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

from workbench.core.errors import InputError, UnwritableError, nearest
from workbench.core.record import Finite, Payload, Position, Record, long_form
from workbench.core.yaml_strict import load, validate
from workbench.machines import TIME, Axis, Hoist, kind_of
from workbench.watch.stream import TRIGGER, Cut, CutRules, Cutter, Logs, on_grid, with_payload

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


def nodes_of(file: Path | None, machine: Hoist | Axis) -> Nodes:
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
        if name not in known:
            raise InputError(f"unknown signal '{name}'; {nearest(name, known)}", file=file, place="nodes")
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
