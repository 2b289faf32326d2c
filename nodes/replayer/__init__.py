"""Republishes a bag."""
