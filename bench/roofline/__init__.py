"""Compares kernels with the peak rates of their device: counts their bytes and operations, and measures their times."""
