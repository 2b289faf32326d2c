"""Primary visibility: triangles into a z-buffer, through any lens."""
