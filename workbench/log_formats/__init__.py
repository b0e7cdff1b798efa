"""Formats of log files: each declared once, and parsed in a worker process.

declared.py   what a format is; limits of what a file may hold
known.py      the formats that are read, and which one a file has
*_file.py     a format each: its declaration and its opener
table.py      what a log gives: columns of numbers
opening.py    opens a log, in this process or in a worker, within its limits
process.py    the worker as this process sees it; worker.py is what runs in it, channel.py what they say
"""

from workbench.log_formats.declared import OWN, UPLOADED, Limits, LogFormat
from workbench.log_formats.known import format_of, formats, listed, suffixes

__all__ = ["OWN", "UPLOADED", "Limits", "LogFormat", "format_of", "formats", "listed", "suffixes"]
