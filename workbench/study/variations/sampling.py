"""Draws of uncertain fields: evenly spread points of the unit cube, mapped by each field's distribution."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from workbench.errors import InputError
from workbench.kinds import kind_of
from workbench.machine import Axis, Hoist, get_value
from workbench.run import Array
from workbench.study.variations.axes import Distribution, SampleBlock


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
