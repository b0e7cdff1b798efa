"""The general tools that the workbench is measured against, each set up as well as its manual allows."""
