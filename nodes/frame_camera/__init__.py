"""Simulates frames of an active-pixel sensor beside the events: exposure, motion blur, shutter, noise and
quantisation."""
