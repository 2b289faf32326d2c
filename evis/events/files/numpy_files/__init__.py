"""Events as NumPy arrays: npz and npy."""
