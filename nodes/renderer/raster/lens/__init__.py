"""Models the camera: its rays, its lens, and what of the image they cover."""
