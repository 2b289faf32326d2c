"""Measures the renderer: its stages, its light, its paths, and other renderers on the same scene."""
