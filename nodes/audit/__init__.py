"""Estimates the error of a run's events, with an interval, from a few pixels that are also computed by brute force."""
