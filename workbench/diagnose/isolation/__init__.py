"""What these runs can tell apart, and which run would decide what is open."""
