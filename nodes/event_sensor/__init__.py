"""Simulates an event sensor: linear luminance in, events out."""
