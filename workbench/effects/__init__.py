"""Effects: physics that a nominal machine does not know, each declared once, as one function.

`of(machine)` turns the names and values of a machine.yaml or a scenario into pieces for the
plant; `names()` and `effects_for(kind)` say what there is; `load_effects(file)` adds a user's own.
"""

from workbench.effects.active import Part, check, idle_sensors, logged_input, of, parts, ranges_of, searchable, sizes_of
from workbench.effects.declare import Effect, EffectMemory, Parameter, Ranged, effect
from workbench.effects.loading import load_effects
from workbench.effects.registry import effects_for, find, forget_users, library_effects, names
