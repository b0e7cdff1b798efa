"""MDF logs (ASAM MDF 4 and 3): the channels of all groups over the time of the fastest."""

from __future__ import annotations

import io
import re
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from workbench.core.errors import InputError
from workbench.logs.formats.declared import Channel, LogFormat, Opened, distinct, over_time, real_numbers, titled

_FUNCTIONS = "sin|cos|tan|asin|acos|atan|arcsin|arccos|arctan|sinh|cosh|tanh|exp|log|log10|sqrt|abs|pow"
_TOKEN = re.compile(rf"\s+|[-+*/(),]|X1?\b|(\d+\.?\d*|\.\d+)([eE][-+]?\d{{1,3}})?|({_FUNCTIONS})(?=\()")
LONGEST_FORMULA = 500
_CLOSED: dict[str, Any] = {"process_bus_logging": False}


def open_mdf(file: Path) -> Opened:
    """Lists the channels of numbers, each name with its unit; `time_s` first."""
    if not file.stat().st_size:
        raise InputError("is empty")
    try:
        from asammdf import MDF
    except ImportError as error:
        raise InputError("MDF files need the extra 'import': pip install '.[import]'") from error
    _without_temporary_files()
    # As a stream: a path may be copied, unpacked, or looked for under another name. What is attached stays packed.
    mdf: Any = MDF(file.open("rb"), **_CLOSED)
    places: list[tuple[int, int]] = []
    titles: list[str] = []
    for g, group in enumerate(mdf.groups):
        master = mdf.masters_db.get(g)
        for i, channel in enumerate(group.channels):
            if i != master and group.channel_group.cycles_nr:
                _check_formulas(channel)
                places.append((g, i))
                titles.append(titled(channel.name, _unit(channel)))
    if not places:
        raise InputError("holds no channels with samples")
    longest = max({g for g, _ in places}, key=lambda g: mdf.groups[g].channel_group.cycles_nr)
    known = dict(zip(distinct(titles), places, strict=True))

    def of(name: str) -> Channel:
        signal = mdf.get(group=known[name][0], index=known[name][1])
        times = np.asarray(signal.timestamps, dtype=np.float64)
        return Channel(name, "", times, real_numbers(name, np.asarray(signal.samples)))

    rows = int(mdf.groups[longest].channel_group.cycles_nr)
    return over_time(list(known), rows, lambda: np.asarray(mdf.get_master(longest), dtype=np.float64), of)


def _check_formulas(channel: Any) -> None:
    """InputError for a conversion whose formula is more than arithmetic: asammdf hands it to Python."""
    conversions = [getattr(channel, "conversion", None)]
    while conversions:
        if (conversion := conversions.pop()) is None:
            continue
        formula = getattr(conversion, "formula", "") or ""
        formula = formula.decode("latin-1") if isinstance(formula, bytes) else str(formula)
        if len(formula) > LONGEST_FORMULA or _TOKEN.sub("", formula):
            said = f"is converted by the formula {formula[:60]!r}, expected arithmetic in X; convert it before saving"
            raise InputError(said, place=str(channel.name))
        inner = getattr(conversion, "referenced_blocks", None) or {}
        conversions += [block for block in inner.values() if hasattr(block, "conversion_type")]


class _Nowhere(io.BytesIO):
    name = ""


def _without_temporary_files() -> None:
    """asammdf begins a temporary file for what is appended. A worker may write no file, and nothing is appended."""
    try:
        tempfile.gettempdir()
    except FileNotFoundError:
        from asammdf.blocks import mdf_v3, mdf_v4

        for module in (mdf_v3, mdf_v4):
            setattr(module, "NamedTemporaryFile", lambda *_, **__: _Nowhere())  # noqa: B010


def _unit(channel: Any) -> str:
    unit = getattr(channel, "unit", "") or getattr(getattr(channel, "conversion", None), "unit", "") or ""
    return str(unit).strip()


MDF = LogFormat(
    name="MDF4",
    suffixes=(".mf4", ".mdf"),
    open=open_mdf,
    about=(
        "ASAM MDF, extra `import`. The channels of numbers of all groups, each named with its unit, `Torque [Nm]`; "
        "`time_s` is the time of the group with the most samples, and channels of other rates are taken at it, linear "
        "between their samples and missing beyond their ends."
    ),
    imports=("asammdf", "asammdf.blocks.mdf_v3", "asammdf.blocks.mdf_v4"),
)
