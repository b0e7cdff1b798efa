"""Studies on more processes and computers than this one, by Dask; an optional extra."""

from workbench.cluster.spread import spread_on

__all__ = ["spread_on"]
