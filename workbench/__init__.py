"""Control-design and what-if study workbench for a winch-driven pipe-handling machine.

`import workbench as wb` gives each task as one function: `wb.read_campaign`, `wb.replay`, `wb.identify`,
`wb.diagnose`, `wb.simulate`, `wb.study`, `wb.compare`, `wb.loop`, `wb.tune`. A name is imported at its first use.
"""

import importlib
from typing import Any

__version__ = "0.1.0"

# Name -> its module. `__init__.pyi` says the same to editors and type checkers; a test holds the two together.
_WHERE = {
    "Campaign": "logs",
    "Hoist": "machines",
    "InputError": "core.errors",
    "Limits": "references",
    "LinearAxis": "machines",
    "PiSettings": "control",
    "RotaryAxis": "machines",
    "Run": "core.run",
    "Step": "references",
    "compare": "api",
    "default_hoist": "machines",
    "load_effects": "effects",
    "load_machine": "api",
    "loop": "api",
    "open_diagnosis": "api",
    "read_campaign": "api",
    "replay": "api",
    "save_machine": "machines",
    "tune": "api",
    "usual_controller": "analysis.usual",
    "with_effects": "api",
    "with_values": "machines",
}
# Sub-packages that can be called, see `workbench.core.verb`.
_VERBS = ("diagnose", "identify", "simulate", "study")

__all__ = ["__version__", *sorted([*_WHERE, *_VERBS])]


def __getattr__(name: str) -> Any:
    if name in _VERBS:
        return importlib.import_module(f"workbench.{name}")
    if name not in _WHERE:
        raise AttributeError(f"module 'workbench' has no attribute '{name}'")
    value = getattr(importlib.import_module(f"workbench.{_WHERE[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
