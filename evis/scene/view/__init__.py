"""Finds what cameras see of a scene before anything is drawn."""
