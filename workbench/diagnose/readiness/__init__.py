"""Whether the runs can be diagnosed, and the condition of their logs."""
