"""The pages, a folder each; `page.py` draws it."""
