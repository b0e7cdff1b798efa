"""Strict YAML: plain data with a line number for every place, and one-line errors."""

from workbench.core.input_file import readable_file
from workbench.core.yaml_strict.checked import problem_lines, validate
from workbench.core.yaml_strict.reader import Document, Place, dotted, dumps, load, loads

__all__ = ["Document", "Place", "dotted", "dumps", "load", "loads", "problem_lines", "readable_file", "validate"]
