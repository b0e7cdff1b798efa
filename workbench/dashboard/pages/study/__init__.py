"""The page Study: one what-if by slider."""
