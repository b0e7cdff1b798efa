"""The blind test of the diagnosis: campaigns whose truth is sealed, diagnosed without it, scored once it is opened."""
