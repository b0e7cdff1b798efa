"""The page Gap: a diagnosis."""
