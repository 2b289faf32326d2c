"""Samples textures with mipmaps: `textures.py` makes these, `texture_kernels.py` reads them."""
