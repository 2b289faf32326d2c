"""Follows a pixel over a surface from one instant to the next, in keyframes or on what is painted there."""
