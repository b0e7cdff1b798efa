"""Controllers as pure step functions: time step and memory are passed in."""

from workbench.control.cascade import cascade, cascade_values
from workbench.control.events import BRAKE, Events
from workbench.control.lag import LagStep, lag_step, weight_before
from workbench.control.pi import (
    NEVER,
    PI,
    Controller,
    delay_weights,
    feed_forward,
    full_pi,
    loop_values,
    losing_a_motor,
)
from workbench.control.settings import (
    FORMS,
    SETTINGS,
    AnyController,
    AxisFeedForward,
    Cascade,
    FeedForward,
    LinearCascade,
    Notch,
    PiSettings,
    RotaryCascade,
    Settings,
    form_of,
)

__all__ = [
    "BRAKE",
    "FORMS",
    "NEVER",
    "PI",
    "SETTINGS",
    "AnyController",
    "AxisFeedForward",
    "Cascade",
    "Controller",
    "Events",
    "FeedForward",
    "LagStep",
    "LinearCascade",
    "Notch",
    "PiSettings",
    "RotaryCascade",
    "Settings",
    "cascade",
    "cascade_values",
    "delay_weights",
    "feed_forward",
    "form_of",
    "full_pi",
    "lag_step",
    "loop_values",
    "losing_a_motor",
    "weight_before",
]
