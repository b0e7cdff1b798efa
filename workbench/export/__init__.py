"""What leaves Python: the plant as an FMU, the controller as C, as structured text and as a drive's parameters."""
