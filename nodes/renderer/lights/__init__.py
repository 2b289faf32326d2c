"""Point, spot, directional and area lights, and the sky."""
