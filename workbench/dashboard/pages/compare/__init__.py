"""The page Compare: kept runs side by side."""
