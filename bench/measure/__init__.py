"""Measures the error of `evis events measure` on rotations of known speed."""
