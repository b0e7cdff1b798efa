"""From fits to the answer: what is left, what speaks for whom, and how likely."""
