"""The multi-body machine: rigid bodies, joints, rollers and wire on the engine Exudyn, an optional extra.

It shares no equation with `workbench.machines`: that the two agree is a finding, not a definition.
"""

from workbench.machines.multibody.assemble import Geometry, Hanging, geometry_of, hang
from workbench.machines.multibody.motion import Driven, MotionResult, Outcome, Shaft, move
from workbench.machines.multibody.switches import Switches, engine, switches_of
