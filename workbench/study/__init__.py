"""Studies: a scenario file, its runs, their index and the folder that keeps them."""
