"""What may be turned, the residuals it acts on, fits of hypotheses, and the search through them."""
