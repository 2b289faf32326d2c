"""The way that a pixel takes over a surface from one instant to the next, in keyframes or on what is painted there."""
