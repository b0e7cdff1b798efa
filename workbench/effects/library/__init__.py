"""The effects that ship: one function each, grouped by the part of the machine that they act on."""
