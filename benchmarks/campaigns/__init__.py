"""Made-up campaigns of hoists and axes whose truth is known, to tune and to measure diagnosis on."""
