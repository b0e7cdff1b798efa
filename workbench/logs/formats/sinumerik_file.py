"""Traces of Siemens' Sinumerik Operate, XML.

Made from two public readers (eliasrhoden/Trace-Tools and a `SinumerikTraceHandler`) that agree on it; no trace of a
machine was at hand, and a trace of STARTER or Startdrive is another format, of which there is no public example. In
`traceData` stands a `dataFrame` with one `dataSignal` a channel, then records, `<rec time="0.002" f1="…" f2="…"/>`:
times in s, values numbered as the signals; a value that does not change is left out. A signal without a description
has that of the same `key` in `traceDisplaySetup`. The bits of an infinite number, as a whole number, are no value.
"""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from workbench.core.errors import InputError
from workbench.logs.formats.declared import Channel, LogFormat, Opened, distinct, over_time

NO_VALUE = 9.2e18


def open_sinumerik(file: Path) -> Opened:
    """Reads all records. InputError for what holds none."""
    root = ElementTree.parse(file).getroot()
    frame = root.find("traceData/dataFrame")
    signals = [] if frame is None else frame.findall("dataSignal")
    records = [] if frame is None else frame.findall("rec")
    if not signals or not records:
        raise InputError("holds no trace: expected traceData with a dataFrame of dataSignal and rec")
    said = {s.get("key"): s.get("description") for s in root.iterfind("traceDisplaySetup/signals/*") if s.get("key")}
    names = distinct([
        (s.get("description") or said.get(s.get("key")) or s.get("name") or f"f{i}").replace("(64 bit)", "").strip()
        for i, s in enumerate(signals, 1)
    ])  # fmt: skip
    time_s = np.array([float(record.attrib["time"]) for record in records])
    values: dict[str, np.ndarray] = {}
    for i, name in enumerate(names, 1):
        column = np.array([float(record.get(f"f{i}", math.nan)) for record in records])
        column[np.abs(column) > NO_VALUE] = math.nan
        known = np.maximum.accumulate(np.where(np.isnan(column), 0, np.arange(len(column))))
        values[name] = column[known]  # of what did not change, the last value
    return over_time(names, len(records), lambda: time_s, lambda name: Channel(name, "", time_s, values[name]))


SINUMERIK = LogFormat(
    name="Sinumerik trace",
    suffixes=(".xml",),
    open=open_sinumerik,
    about=(
        "XML of Siemens' Sinumerik Operate, made from two public readers; no trace of a machine was at hand. A value "
        "that is left out is the one before. Units are not said."
    ),
    imports=("xml.etree.ElementTree", "xml.parsers.expat"),
)
