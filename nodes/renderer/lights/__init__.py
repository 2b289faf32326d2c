"""Computes the light of point, spot, directional and area lights, and of the sky."""
