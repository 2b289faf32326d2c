"""Reads frames from anywhere as linear luminance: NumPy archives, folders of images, videos."""
