"""A Plotly figure on a page, which keeps the reader's zoom when it changes.

`st.plotly_chart` puts a changed figure in place of the old one, whose zoom goes with it, and draws each several times.
Here one drawing is changed (`Plotly.react` under a `uirevision`), by assets/chart.js as a component of streamlit's.
The library is that of the Python package, served from there: figure and drawing are of one version.
"""

from __future__ import annotations

import importlib.metadata
import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

from streamlit.components import v2
from streamlit.components.v2.get_bidi_component_manager import get_bidi_component_manager
from streamlit.components.v2.manifest_scanner import ComponentConfig, ComponentManifest

from workbench.dashboard.ahead import library

if TYPE_CHECKING:
    from plotly.graph_objects import Figure
    from streamlit.components.v2.component_manager import BidiComponentManager

CHART, PLOTLY = "workbench.chart", "workbench.plotly"
_mounts: WeakKeyDictionary[BidiComponentManager, Callable[..., Any]] = WeakKeyDictionary()


def draw(figure: Figure, key: str, config: dict[str, Any], alt: str | None) -> None:
    """The figure over the page's width. key: its identity, under which a changed figure keeps zoom and legend."""
    said = f'{{"figure": {figure.to_json(validate=False)}, "config": {json.dumps(config)}, "alt": {json.dumps(alt)}}}'
    _mount()(key=_safe(key), data=said.encode())


def load_ahead() -> None:
    """Has the browser load the library while the server still computes what is to be drawn."""
    _mount()(key="chart library")


def _safe(key: str) -> str:
    """The key without `__`, which streamlit keeps for itself in a component's key; different keys stay different.

    Job numbers and the names of runs, which are random or a user's, may hold it.
    """
    return key.replace("%", "%25").replace("_", "%5F")


def _mount() -> Callable[..., Any]:
    """The component, made known to the server that runs."""
    manager = get_bidi_component_manager()
    if manager not in _mounts:
        version = importlib.metadata.version("plotly")
        for name, folder in ((CHART, Path(__file__).parent / "assets"), (PLOTLY, library().parent)):
            first, _, second = name.partition(".")
            parts = [ComponentConfig(second, folder.name)]
            manager.register_from_manifest(ComponentManifest(first, version, parts), folder.parent)
        _mounts[manager] = v2.component(CHART, js="chart.js", isolate_styles=False)
    return _mounts[manager]
