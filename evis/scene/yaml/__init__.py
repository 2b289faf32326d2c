"""Scene files: checked reading, and what each of their sections becomes."""
