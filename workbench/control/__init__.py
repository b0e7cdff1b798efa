"""Controllers as pure step functions: time step and memory are passed in."""

from workbench.control.events import BRAKE, Events
from workbench.control.lag import LagStep, lag_step, weight_before
from workbench.control.pi import PI, Controller, delay_weights, full_pi, loop_values
from workbench.control.settings import FeedForward, Notch, PiSettings

__all__ = [
    "BRAKE",
    "PI",
    "Controller",
    "Events",
    "FeedForward",
    "LagStep",
    "Notch",
    "PiSettings",
    "delay_weights",
    "full_pi",
    "lag_step",
    "loop_values",
    "weight_before",
]
