"""Where the gap lies: over which variable, in which windows, in which part of the machine."""
