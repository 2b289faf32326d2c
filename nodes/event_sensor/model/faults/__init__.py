"""Faults of a real sensor, and the random numbers that they are drawn by."""
