"""Formats of log files: each declared once, and parsed in a worker process.

declared.py   what a format is; limits of what a file may hold
known.py      the formats that are read, and which one a file has
*_file.py     a format each: its declaration and its opener
opening.py    opens a log as columns of numbers, in this process or in a worker, within its limits
worker.py     the worker: what runs in it, and what this process sees of it
confined.py   what a worker may touch: the one file that it parses
"""

from workbench.logs.formats.declared import OWN, UPLOADED, Limits, LogFormat
from workbench.logs.formats.known import format_of, formats, listed, suffixes

__all__ = ["OWN", "UPLOADED", "Limits", "LogFormat", "format_of", "formats", "listed", "suffixes"]
