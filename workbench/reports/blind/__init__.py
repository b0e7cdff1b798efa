"""The score of a blind test: tables, sentences, JSON and a page."""
