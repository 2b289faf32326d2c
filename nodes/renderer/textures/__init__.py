"""Textures with mipmaps."""
