"""An unknown cause as a table over what explains it best."""
