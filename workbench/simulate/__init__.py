"""Simulations that an engineer asks for: replay of a log, inverse simulation, the closed loop."""

from workbench.core.verb import make_callable

make_callable(__name__)
