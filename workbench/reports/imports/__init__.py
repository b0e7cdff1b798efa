"""Reports of an import."""
