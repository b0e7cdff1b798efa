"""Studies on more processes and computers than this one, by Dask; an optional extra."""

from workbench.cluster.spread import client_on, each_on, spread_on

__all__ = ["client_on", "each_on", "spread_on"]
