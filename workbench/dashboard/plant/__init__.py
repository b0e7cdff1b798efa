"""A served plant and its session: a process of its own, how it is asked, the built-in client."""
