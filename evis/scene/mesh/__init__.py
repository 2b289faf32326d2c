"""Makes triangle meshes: of primitive shapes, and from files."""
