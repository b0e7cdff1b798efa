"""What plays the real machine: simulators of hoists and axes, the multi-body machine, the workbench's own plant."""
