"""What a command prints and writes: tables and sentences as text, JSON, pages."""
