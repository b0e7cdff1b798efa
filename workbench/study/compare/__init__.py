"""Two results of a study compared, metric by metric."""
