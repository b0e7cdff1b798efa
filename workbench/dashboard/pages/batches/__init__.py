"""The page Batches: large studies."""
