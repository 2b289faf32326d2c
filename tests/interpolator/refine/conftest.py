"""Puts this folder on the path, so that the tests of its rooms find refine_rig."""
