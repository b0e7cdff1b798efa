"""Made-up campaigns of axes (`kind: axis`), linear and rotary, from gram to tonne."""
