"""Files that a browser sends: their limits, and a campaign made of them."""
