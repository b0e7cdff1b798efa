"""Which nodes of a server are which signals: a nodes.yaml, or those of a plant that `workbench serve` serves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from workbench.errors import InputError, nearest
from workbench.kinds import TIME, Kind, kind_of
from workbench.logs.plausible import driven_signals
from workbench.machine import Axis, Hoist
from workbench.record import Finite, Payload, Position, Record
from workbench.watch.stream.cut import TRIGGER
from workbench.yaml_strict import load, validate

PAYLOAD = "payload_kg"
SERVED = "nsu=urn:workbench:plant;s=Plant.Outputs."
SERVED_PAYLOAD = "payload_now_kg"


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
        """`signal: node` is short for `signal: {node: node}`."""
        if isinstance(data, dict) and isinstance(nodes := data.get("nodes"), dict):
            long = {key: {"node": value} if isinstance(value, str) else value for key, value in nodes.items()}
            return {**data, "nodes": long}
        return data


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
    position, speed = driven_signals(kind)
    nodes = dict(made.nodes) | ({TRIGGER: Node(node=made.trigger)} if made.trigger is not None else {})
    return Nodes(nodes, speed if speed in nodes else position, speed not in nodes, fixed)


def served_nodes(kind: Kind) -> NodesFile:
    """Those of a plant that `workbench serve --protocol opcua` serves."""
    shown = {signal.name for signal in kind.plant.signals}
    nodes = {name: Node(node=f"{SERVED}{name}") for name in kind.signals.names if name in shown}
    nodes[kind.plant.input] = Node(node=f"{SERVED}{served_input(kind)}")
    if kind.payload:
        nodes[PAYLOAD] = Node(node=f"{SERVED}{SERVED_PAYLOAD}")
    return NodesFile(nodes=nodes)


def served_input(kind: Kind) -> str:
    """The point of a served plant that has the input behind limits and lag."""
    return f"{kind.drive.quantity}_at_work_{kind.drive.suffix}"
