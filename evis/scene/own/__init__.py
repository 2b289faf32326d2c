"""Replaces pictures and meshes made by code by a user's own: folders, from which the seed draws."""
