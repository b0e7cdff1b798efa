"""Controllers as pure step functions: time step and memory are passed in."""

from workbench.control.pi import PI, PiSettings

__all__ = ["PI", "PiSettings"]
