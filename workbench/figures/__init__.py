"""Figures: arrays and runs in, plotly figures out. Only `save` touches a file."""
