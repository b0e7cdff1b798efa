"""Studies: a scenario file, its runs, their index and the folder that keeps them."""

from workbench.core.verb import make_callable

make_callable(__name__)
