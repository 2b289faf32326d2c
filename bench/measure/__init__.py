"""`evis events measure` against rotations of known speed."""
