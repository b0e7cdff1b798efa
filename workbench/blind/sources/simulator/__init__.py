"""Simulators of hoists and axes that share no equation with the plant that the diagnosis knows."""
