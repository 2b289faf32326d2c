"""Lets the rooms of tests import the scenes of this folder: pytest puts the folder of a conftest.py on the path."""
