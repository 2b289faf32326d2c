"""Triangle meshes: of primitive shapes, and from files."""
