"""The page Plant: a served plant live, faults at a click."""
