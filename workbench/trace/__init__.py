"""The name by which users' files of effects know `workbench.symbolic`."""
