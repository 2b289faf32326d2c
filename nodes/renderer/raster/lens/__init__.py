"""The camera: its rays, its lens, and what of the image they cover."""
