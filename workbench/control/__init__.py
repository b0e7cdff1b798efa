"""Controllers as pure step functions: time step and memory are passed in."""

from workbench.control.events import BRAKE, Events
from workbench.control.pi import (
    NEVER,
    PI,
    Controller,
    cascade,
    cascade_values,
    delay_weights,
    feed_forward,
    full_pi,
    hoist_loop,
    lag_step,
    loop_values,
    losing_a_motor,
    weight_before,
)
from workbench.control.settings import (
    SETTINGS,
    AnyController,
    AxisFeedForward,
    Cascade,
    FeedForward,
    InputShaper,
    LinearCascade,
    Notch,
    PiSettings,
    RotaryCascade,
    ScheduledGains,
    Settings,
    form_of,
    refuse,
)
