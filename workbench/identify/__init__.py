"""From logs to a machine's parameters, with error bars."""

from workbench.core.verb import make_callable

make_callable(__name__)
