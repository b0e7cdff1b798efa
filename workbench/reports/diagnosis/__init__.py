"""What `diagnose` prints and writes."""
