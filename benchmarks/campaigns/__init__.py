"""Made-up campaigns of hoists whose truth is known, to tune and to measure diagnosis on."""
