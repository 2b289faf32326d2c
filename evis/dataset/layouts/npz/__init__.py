"""Writes and reads plain archives of NumPy."""
