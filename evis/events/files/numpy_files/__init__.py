"""Reads and writes events as NumPy arrays: npz and npy."""
