"""Puts a user's own pictures and meshes in the place of those by code: folders, from which the seed draws."""
