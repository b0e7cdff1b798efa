"""Fields and metrics in words and units, as people read them."""

from __future__ import annotations

import re
from dataclasses import dataclass

from workbench.metrics import by_name

_UNITS = {
    "nm_s_per_rad": "N m s/rad",
    "nm_per_rad": "N m/rad",
    "nm_per_s": "N m/s",
    "n_s_per_m": "N s/m",
    "s_per_m": "s/m",
    "kg_m2": "kg m²",
    "n_per_s": "N/s",
    "n_per_m": "N/m",
    "rad_s3": "rad/s³",
    "rad_s2": "rad/s²",
    "rad_s": "rad/s",
    "m_s3": "m/s³",
    "m_s2": "m/s²",
    "m_s": "m/s",
    "per_s": "1/s",
    "percent": "%",
    "nm": "N m",
    "kg": "kg",
    "hz": "Hz",
    "pa": "Pa",
    "m2": "m²",
    "kw": "kW",
    "rad": "rad",
    "n": "N",
    "j": "J",
    "m": "m",
    "s": "s",
}
# Blocks of the machine whose values need no more words.
_SILENT = ("sensors", "motor", "bearing", "gearbox")


@dataclass(frozen=True)
class Label:
    """words, without the unit; unit as shown, "" for a bare number."""

    words: str
    unit: str

    @property
    def axis(self) -> str:
        return f"{self.words} ({self.unit})" if self.unit else self.words

    def of(self, value: float | str) -> str:
        """`jerk 0.8 m/s³`; a word says itself."""
        return f"{self.words} {shown(value)} {self.unit}".strip()


def shown(value: float | str) -> str:
    return value.replace("_", " ") if isinstance(value, str) else f"{value:.4g}"


def field_label(column: str) -> Label:
    """Of a column of the index that a sweep or a sample has set, such as `sweep.limits.jerk_m_s3`."""
    path = re.sub(r"^(sweep|sample)\.", "", column).split(".")
    words, unit = _parted(path[-1])
    if (move := re.fullmatch(r"moves\[(\d+)\]", path[0])) is not None:
        words = f"move {int(move[1]) + 1} {words}"
    elif len(path) > 2 and path[-2] not in _SILENT and path[-2] not in words:
        words = f"{path[-2]} {words}".replace("_", " ")
    return Label(words, unit)


def drawn_in(name: str) -> tuple[Label, float]:
    """A metric as figures draw it: its label with the unit shown, and what its values are multiplied by."""
    metric = by_name().get(name)
    return (metric_label(name), 1.0) if metric is None else (Label(metric.label, metric.shown_unit), metric.scale)


def metric_label(name: str) -> Label:
    """A metric's label and unit; of a column that is no declared metric, such as an older version's, from its name."""
    metric = by_name().get(name)
    if metric is None:
        return Label(*_parted(name))
    return Label(metric.label, "" if metric.unit == "–" else metric.unit)


def _parted(name: str) -> tuple[str, str]:
    for ending, unit in _UNITS.items():
        if name.endswith(f"_{ending}"):
            return name.removesuffix(f"_{ending}").replace("_", " "), unit
    return name.replace("_", " "), ""
