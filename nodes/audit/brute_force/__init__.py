"""Computes the luminance of chosen pixels at any instant by brute force: every ray cast, every point shaded, nothing
reused."""
