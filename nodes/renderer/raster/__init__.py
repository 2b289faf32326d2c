"""Computes primary visibility: triangles into a z-buffer, through any lens."""
