"""Parameters, residuals, fits of hypotheses, and the search among the effects."""
