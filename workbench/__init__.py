"""Control-design and what-if study workbench for a winch-driven pipe-handling machine."""

__version__ = "0.1.0"
