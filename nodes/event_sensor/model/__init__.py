"""Defines the event model for any device: a pixel's state, its thresholds, crossing times, noise."""
