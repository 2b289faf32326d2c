"""Finds where the light on a surface changes between two keyframes, so that what they show there must not be carried
over."""
