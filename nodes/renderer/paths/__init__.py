"""Computes light over several surfaces, by paths."""
