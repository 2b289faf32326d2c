"""Holds a scene's triangles and body poses as flat arrays on the device."""
