"""Samples textures with mipmaps."""
