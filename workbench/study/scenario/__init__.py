"""The scenario file: its record, how it is read, checked and written."""
