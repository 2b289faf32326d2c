"""Finds what is in the way of light: occluders, rays against them, grids that save rays."""
