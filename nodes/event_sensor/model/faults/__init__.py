"""Computes the faults of a real sensor, and the random numbers that they are drawn by."""
