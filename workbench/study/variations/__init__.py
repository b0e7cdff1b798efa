"""From a scenario to its runs: sweeps, samples, and each run fully resolved."""
