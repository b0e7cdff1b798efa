"""The page Validate: replay and identification."""
