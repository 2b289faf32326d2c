"""Augments windows of events with their labels: mirrored, cropped, backwards in time, with noise."""
