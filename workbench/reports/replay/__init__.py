"""What `replay` prints and writes."""
