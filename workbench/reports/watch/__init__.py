"""Reports of a watch."""
