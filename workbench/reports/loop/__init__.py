"""What `loop` and `tune` print and write."""
