"""The page Loop: margins and tuning."""
