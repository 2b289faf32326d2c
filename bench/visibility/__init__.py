"""Compares two ways to find what a sub-frame sees: the raster, and points moved from the keyframes."""
