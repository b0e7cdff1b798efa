"""What `compare-models` prints and writes."""
