"""The loop as linear systems: the plant at an operating point, margins, and gains from them."""
