"""What a scenario varies: `sweep`, over listed values and ranges, and `sample`, from distributions.
Draws of uncertain fields: evenly spread points of the unit cube, mapped by each field's distribution."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    AfterValidator,
    ConfigDict,
    Discriminator,
    Field,
    PlainValidator,
    Tag,
    field_validator,
    model_validator,
)

from workbench.core.errors import InputError, nearest
from workbench.core.record import Finite, Positive, Record
from workbench.core.run import Array
from workbench.machines import Axis, Hoist, get_value, kind_of

MOST_VALUES = 100_000


def _plain(value: Any) -> Any:
    if isinstance(value, bool | str):
        return value
    if isinstance(value, int | float) and math.isfinite(value):
        return float(value)
    raise ValueError(f"{value!r}, expected a finite number, a word, true or false")


# One validator for all three, so that one wrong value is one complaint.
Value = Annotated[float | bool | str, PlainValidator(_plain, json_schema_input_type=float | bool | str)]


class RangeBlock(Record):
    """Numbers from `from` to `to`, both included: `steps` of them, or one every `step`; linear, or in equal ratios."""

    model_config = ConfigDict(serialize_by_alias=True)

    from_: Annotated[Finite, Field(alias="from")]
    to: Finite
    steps: Annotated[int, Field(ge=2, le=MOST_VALUES, strict=True)] | None = None
    step: Positive | None = None
    scale: Literal["linear", "log"] = "linear"

    @model_validator(mode="after")
    def _whole(self) -> RangeBlock:
        if (self.steps is None) == (self.step is None):
            raise ValueError("expected either steps, how many numbers, or step, how far apart they lie")
        if self.from_ == self.to:
            raise ValueError(f"from and to are both {self.to:g}, expected two numbers")
        if self.scale == "log":
            if self.step is not None:
                raise ValueError("a logarithmic range goes in equal ratios: give steps in place of step")
            if min(self.from_, self.to) <= 0.0:
                raise ValueError(f"a logarithmic range from {self.from_:g} to {self.to:g}, expected numbers above 0")
        if self.step is not None:
            number = abs(self.to - self.from_) / self.step
            if number > MOST_VALUES:
                raise ValueError(f"holds {number:.3g} numbers, expected at most {MOST_VALUES}")
            if abs(number - round(number)) > 1e-6 * max(number, 1.0):
                raise ValueError(
                    f"steps of {self.step:g} from {self.from_:g} do not meet {self.to:g}; "
                    f"expected a whole number of steps, or steps: {round(number) + 1}"
                )
        return self

    def values(self) -> list[float]:
        """The numbers, rounded to twelve digits so that 0.1 · 3 reads 0.3; the ends are exact."""
        low, high = self.from_, self.to
        count = self.steps if self.steps is not None else round(abs(high - low) / (self.step or 1.0)) + 1
        if self.scale == "log":
            inner = [low * (high / low) ** (i / (count - 1)) for i in range(1, count - 1)]
        else:
            inner = [low + (high - low) * i / (count - 1) for i in range(1, count - 1)]
        return [low, *(float(f"{value:.12g}") for value in inner), high]


def _list_or_range(value: Any) -> str:
    return "range" if isinstance(value, dict | RangeBlock) else "list"


def _not_empty(values: tuple[Any, ...]) -> tuple[Any, ...]:
    if not 1 <= len(values) <= MOST_VALUES:
        raise ValueError(f"holds {len(values)} values, expected 1 to {MOST_VALUES}")
    return values


Listed = Annotated[tuple[Value, ...], AfterValidator(_not_empty), Field(json_schema_extra={"minItems": 1})]
AxisValues = Annotated[
    Annotated[Listed, Tag("list")] | Annotated[RangeBlock, Tag("range")], Discriminator(_list_or_range)
]


def listed(values: tuple[Value, ...] | RangeBlock) -> list[Value]:
    """The values of one axis."""
    return list(values.values()) if isinstance(values, RangeBlock) else list(values)


class SweepBlock(Record):
    """field: values, for every field that is swept; each is combined with each.

    Fields under `zip` are walked together: first values, second values, …; they are one axis.
    """

    model_config = ConfigDict(extra="allow", frozen=True)
    __pydantic_extra__: dict[str, AxisValues]

    zip: dict[str, AxisValues] = Field(default_factory=dict)

    @property
    def grid(self) -> dict[str, tuple[Value, ...] | RangeBlock]:
        return dict(self.__pydantic_extra__ or {})


_NEEDS = {
    "uniform": ("low", "high"),
    "normal": ("mean", "std"),
    "lognormal": ("median", "sigma"),
    "triangular": ("low", "mode", "high"),
}


class Distribution(Record):
    """One drawn field. With `relative: true` the number drawn multiplies the field's own value.

    uniform: low, high. normal: mean, std. lognormal: median, and sigma, the standard deviation of
    the logarithm. triangular: low, mode, high.
    """

    distribution: Literal["uniform", "normal", "lognormal", "triangular"]
    relative: bool = False
    low: Finite | None = None
    high: Finite | None = None
    mode: Finite | None = None
    mean: Finite | None = None
    std: Positive | None = None
    median: Positive | None = None
    sigma: Positive | None = None

    @model_validator(mode="after")
    def _whole(self) -> Distribution:
        needs = _NEEDS[self.distribution]
        given = [n for n in ("low", "high", "mode", "mean", "std", "median", "sigma") if getattr(self, n) is not None]
        for name in given:
            if name not in needs:
                raise ValueError(f"a {self.distribution} distribution has no {name}; {nearest(name, needs)}")
        if missing := [name for name in needs if name not in given]:
            raise ValueError(f"a {self.distribution} distribution needs {' and '.join(needs)}; missing: {missing[0]}")
        order = [getattr(self, name) for name in needs]
        if "low" in needs and not (order == sorted(order) and order[0] < order[-1]):
            raise ValueError(f"expected {' <= '.join(needs)}, got {', '.join(f'{x:g}' for x in order)}")
        return self


class SampleBlock(Record):
    """Draws from distributions; every draw runs at every point of the sweep, so that points compare.

    tolerances: draw what the machine's tolerances name, each normal about its nominal value.
    seed: the scenario's own when missing.
    """

    count: Annotated[int, Field(ge=1, le=MOST_VALUES * 10, strict=True)]
    method: Literal["latin_hypercube", "sobol"] = "latin_hypercube"
    seed: Annotated[int, Field(ge=0, strict=True)] | None = None
    tolerances: bool = False
    values: dict[str, Distribution] = Field(default_factory=dict)

    @field_validator("tolerances", mode="before")
    @classmethod
    def _a_switch(cls, value: object) -> object:
        if not isinstance(value, bool):
            raise ValueError(f"{value!r}, expected true or false")
        return value

    @model_validator(mode="after")
    def _whole(self) -> SampleBlock:
        if not self.tolerances and not self.values:
            raise ValueError("draws nothing; expected values: or tolerances: true")
        if self.method == "sobol" and self.count & (self.count - 1):
            below = 1 << (self.count.bit_length() - 1)
            raise ValueError(
                f"{self.count} draws of a Sobol sequence are not balanced; expected a power of two, "
                f"{below} or {2 * below}"
            )
        return self


def distributions(block: SampleBlock, machine: Hoist | Axis) -> dict[str, Distribution]:
    """What is drawn: the machine's tolerances where asked for, and what `values` names, which goes over them."""
    drawn: dict[str, Distribution] = {}
    if block.tolerances:
        kind = kind_of(machine)
        for name in kind.looped.drawn:
            base = kind.base_value(name)
            std = getattr(machine.tolerances, base.tolerance) if base is not None else 0.0
            if std > 0.0 and get_value(machine, name) != 0.0:
                drawn[f"machine.{name}"] = Distribution(distribution="normal", relative=True, mean=1.0, std=std)
        if not drawn:
            raise InputError("every tolerance of the machine is 0, nothing to draw", place="sample.tolerances")
    return drawn | block.values


def draws(block: SampleBlock, chosen: Mapping[str, Distribution], seed: int) -> Array:
    """(count, fields): the numbers drawn, factors where a distribution is relative. The seed decides them."""
    points = np.clip(_unit_points(block, len(chosen), seed), 2.0**-53, 1.0 - 2.0**-53)
    columns = [_quantile(distribution, points[:, k]) for k, distribution in enumerate(chosen.values())]
    return np.stack(columns, axis=-1)


def _unit_points(block: SampleBlock, dimensions: int, seed: int) -> Array:
    from scipy.stats import qmc

    if block.method == "sobol":
        if dimensions > qmc.Sobol.MAXDIM:
            raise InputError(f"{dimensions} fields, a Sobol sequence has at most {qmc.Sobol.MAXDIM}", place="sample")
        return np.asarray(qmc.Sobol(dimensions, scramble=True, rng=seed).random(block.count))
    return np.asarray(qmc.LatinHypercube(dimensions, rng=seed).random(block.count))


def _quantile(d: Distribution, u: Array) -> Array:
    """The value below which the share u of all draws lies."""
    from scipy.special import ndtri

    if d.distribution == "normal":
        assert d.mean is not None and d.std is not None
        return np.asarray(d.mean + d.std * ndtri(u))
    if d.distribution == "lognormal":
        assert d.median is not None and d.sigma is not None
        return np.asarray(d.median * np.exp(d.sigma * ndtri(u)))
    assert d.low is not None and d.high is not None
    if d.distribution == "uniform":
        return d.low + (d.high - d.low) * u
    assert d.mode is not None
    width, rise = d.high - d.low, d.mode - d.low
    # The density is a triangle: its area grows with the square of the distance from either end.
    up = d.low + np.sqrt(u * width * rise)
    down = d.high - np.sqrt((1.0 - u) * width * (d.high - d.mode))
    return np.where(u * width < rise, up, down)
