"""Controllers as pure step functions: time step and memory are passed in."""

from workbench.control.events import Events
from workbench.control.pi import NEVER, PI, Controller, cascade, delay_weights, full_pi, lag_step, loop_values
from workbench.control.settings import SETTINGS, Cascade, FeedForward, LinearCascade, Notch, PiSettings, Settings
