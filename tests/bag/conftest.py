"""Lets the rooms of tests import the modules of this folder: pytest puts the folder of a conftest.py on the path."""
