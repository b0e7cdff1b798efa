"""Formats of log files: each declared once, and parsed in a worker process that can open nothing but that file."""
