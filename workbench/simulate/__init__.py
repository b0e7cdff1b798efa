"""Simulations that an engineer asks for: replay of a log, inverse simulation, the closed loop."""
