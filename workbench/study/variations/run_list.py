"""All runs of a scenario, made one by one when they are asked for."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import overload

from workbench.errors import InputError
from workbench.study.scenario.fields import Fields, Parts
from workbench.study.scenario.record import Scenario
from workbench.study.variations.grid import GridAxis, labels_of
from workbench.study.variations.run_spec import Recording, RunSpec

Assigned = dict[str, float | bool | str]
LONGEST_ID = 140


@dataclass(frozen=True)
class RunList(Sequence[RunSpec]):
    """The runs of a scenario by number: sweep points, of each the draws, of each payloads, of each references.

    Numbers and ids follow from the scenario alone; any slice can be had without the rest.
    """

    fields: Fields
    axes: tuple[GridAxis, ...]
    recordings: Mapping[str, Recording]
    duration_s: float = math.nan
    _payloads: tuple[tuple[float | None, str], ...] = field(init=False)

    def __post_init__(self) -> None:
        payloads = self.scenario.payloads_kg
        labels = labels_of(payloads) if payloads is not None else [""]
        object.__setattr__(self, "_payloads", tuple(zip(payloads or (None,), labels, strict=True)))

    @property
    def scenario(self) -> Scenario:
        return self.fields.scenario

    def __len__(self) -> int:
        return math.prod((*map(len, self.axes), len(self._payloads), len(self.scenario.references)))

    @overload
    def __getitem__(self, index: int) -> RunSpec: ...
    @overload
    def __getitem__(self, index: slice) -> list[RunSpec]: ...
    def __getitem__(self, index: int | slice) -> RunSpec | list[RunSpec]:
        if isinstance(index, slice):
            return [self._spec(i) for i in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"run {index} of {len(self)}")
        return self._spec(index % len(self))

    def _spec(self, index: int) -> RunSpec:
        rest, kind = divmod(index, len(self.scenario.references))
        rest, load = divmod(rest, len(self._payloads))
        at = []
        for axis in reversed(self.axes):
            rest, k = divmod(rest, len(axis))
            at.append(k)
        payload, label = self._payloads[load]
        swept, sampled = self.assigned(at[::-1], payload)
        problem = ""
        try:
            parts = self.fields.parts(swept | sampled)
        except InputError as error:
            # Each value fits by itself; these do not fit together. The run is a row that says so.
            parts, problem = self.fields.parts({}), str(error)
        return self._resolved(parts, at[::-1], kind, payload, label, swept, sampled, problem)

    def _resolved(
        self, parts: Parts, at: Sequence[int], kind: int, payload: float | None, label: str,
        swept: Assigned, sampled: Assigned, problem: str,
    ) -> RunSpec:  # fmt: skip
        scenario = self.scenario
        reference = scenario.kinds[kind]
        recording = self.recordings.get(reference)
        load = parts.payload_kg if parts.payload_kg is not None else payload
        start = recording.start_position_m if recording is not None else parts.start_position_m
        return RunSpec(
            run_id=self._run_id(label, reference, at),
            scenario=scenario.name,
            machine=parts.machine,
            payload_kg=0.0 if load is None else load,
            start_position_m=0.0 if start is None else start,
            reference=reference,
            moves=parts.moves,
            limits=parts.limits,
            lead_s=parts.lead_s,
            settle_s=parts.settle_s,
            duration_s=self.duration_s,
            controller=parts.controller,
            events=parts.events,
            effects=parts.machine.effects,
            step_s=parts.step_s,
            plant=scenario.plant,
            record_every=_record_every(scenario, parts),
            recording=recording,
            assigned={f"sweep.{name}": _column(value) for name, value in swept.items()}
            | {f"sample.{name}": _column(value) for name, value in sampled.items()},
            problem=problem,
        )

    def assigned(self, at: Sequence[int], payload: float | None) -> tuple[Assigned, Assigned]:
        """What sweep and sample set at a point of the axes; drawn factors are multiplied out."""
        return self._set(zip(self.axes, at, strict=True), payload)

    def _set(self, points: Iterable[tuple[GridAxis, int]], payload: float | None) -> tuple[Assigned, Assigned]:
        swept: Assigned = {}
        sampled: Assigned = {}
        for axis, k in points:
            if not axis.sampled:
                swept.update(zip(axis.names, axis.values[k], strict=True))
                continue
            for name, value, relative in zip(axis.names, axis.values[k], axis.relative, strict=True):
                if relative:
                    own = swept.get(name, payload if name == "payload_kg" else self.fields.value(name))
                    value = float(value) * float(own) if own is not None else math.nan
                sampled[name] = value
        return swept, sampled

    def motion_parts(self, points: Iterable[tuple[GridAxis, int]]) -> Parts:
        """The parts with only these axes set, the rest as the file has it."""
        swept, sampled = self._set(points, None)
        return self.fields.parts(swept | sampled)

    def _run_id(self, label: str, reference: str, at: Sequence[int]) -> str:
        parts = [axis.labels[k] for axis, k in zip(self.axes, at, strict=True)]
        name = "_".join(part for part in (f"{label}kg" if label else "", reference, *parts) if part)
        if len(name) > LONGEST_ID:
            digest = hashlib.sha256(name.encode()).hexdigest()[:16]
            name = "_".join(part for part in (f"{label}kg" if label else "", reference, digest) if part)
        return name


def _record_every(scenario: Scenario, parts: Parts) -> int:
    outputs = scenario.outputs
    if outputs.signals == "none":
        return 0
    return 1 if outputs.signals == "full" else max(1, round(outputs.every_s / parts.controller.sample_time_s))


def _column(value: float | bool | str) -> float | str:
    """Index columns hold numbers or words."""
    return value if isinstance(value, str) else float(value)
