"""The kinds of references that ship, each declared once."""
