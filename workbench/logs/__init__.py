"""Recorded campaigns: a machine and its measured runs, read, checked and repaired where that is safe."""

from workbench.logs.campaign import Campaign, read_campaign

__all__ = ["Campaign", "read_campaign"]
