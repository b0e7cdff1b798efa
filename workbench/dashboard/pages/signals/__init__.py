"""The page Signals: the raw logs of a campaign."""
