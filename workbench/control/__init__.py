"""Controllers as pure step functions: time step and memory are passed in."""

from workbench.control.events import BRAKE, Events
from workbench.control.lag import LagStep, lag_step, weight_before
from workbench.control.pi import NEVER, PI, Controller, delay_weights, feed_forward, full_pi, loop_values
from workbench.control.settings import FeedForward, Notch, PiSettings

__all__ = [
    "BRAKE",
    "NEVER",
    "PI",
    "Controller",
    "Events",
    "FeedForward",
    "LagStep",
    "Notch",
    "PiSettings",
    "delay_weights",
    "feed_forward",
    "full_pi",
    "lag_step",
    "loop_values",
    "weight_before",
]
