"""What `identify` prints and writes."""
