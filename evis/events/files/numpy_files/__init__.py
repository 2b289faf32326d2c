"""Reads and writes events as NumPy arrays: `npz.py` archives of one array per column, `npy.py` reads one array with a
row per event."""
