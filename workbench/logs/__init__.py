"""Recorded campaigns: a machine and its measured runs, read, checked and repaired where that is safe.

`Campaign` and `read_campaign` are imported at their first use: a reader of formats starts without the machines.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from workbench.logs.campaign import Campaign, read_campaign

__all__ = ["Campaign", "read_campaign"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'workbench.logs' has no attribute '{name}'")
    from workbench.logs import campaign

    return getattr(campaign, name)
