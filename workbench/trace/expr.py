"""`workbench.symbolic.expr` by the name that users' files of effects know it by."""

from workbench.symbolic.expr import *  # noqa: F403
