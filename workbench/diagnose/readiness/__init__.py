"""Whether the runs can be diagnosed at all, and how fit they are."""
