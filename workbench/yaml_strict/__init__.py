"""Strict YAML: plain data with a line number for every place, and one-line errors."""

from workbench.input_file import readable_file
from workbench.yaml_strict.checked import problem_lines, validate
from workbench.yaml_strict.reader import Document, Place, dotted, dumps, load, loads

__all__ = ["Document", "Place", "dotted", "dumps", "load", "loads", "problem_lines", "readable_file", "validate"]
