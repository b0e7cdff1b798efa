"""From logs to a machine's parameters, with error bars."""
