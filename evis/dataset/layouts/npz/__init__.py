"""Plain archives of NumPy."""
