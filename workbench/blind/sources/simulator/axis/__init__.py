"""Axes (`kind: axis`), linear and rotary, from gram to tonne: nominal machines, what can ail them, and their motion."""
