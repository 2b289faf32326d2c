"""Frames from anywhere as linear luminance: NumPy archives, folders of EXR or PNG, videos."""
