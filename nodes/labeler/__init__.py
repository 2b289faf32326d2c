"""Computes exact ground truth at the stamps of the event packets."""
