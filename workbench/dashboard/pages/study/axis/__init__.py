"""The page Study for an axis: a cascade, no payload, no wire."""
