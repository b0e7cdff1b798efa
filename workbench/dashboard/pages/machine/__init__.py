"""The page Machine: a run as a moving drawing."""
