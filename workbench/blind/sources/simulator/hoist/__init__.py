"""Hoists: their nominal machines, what can ail them, and their motion."""
