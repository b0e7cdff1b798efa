"""Controllers as pure step functions: time step and memory are passed in."""

from workbench.control.events import BRAKE, Events
from workbench.control.pi import NEVER, PI, Controller, delay_weights, feed_forward, full_pi, loop_values
from workbench.control.settings import FeedForward, Notch, PiSettings

__all__ = [
    "BRAKE",
    "NEVER",
    "PI",
    "Controller",
    "Events",
    "FeedForward",
    "Notch",
    "PiSettings",
    "delay_weights",
    "feed_forward",
    "full_pi",
    "loop_values",
]
