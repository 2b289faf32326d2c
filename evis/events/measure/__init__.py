"""Measures event streams: rate, noise, sharpness and the rotation they show. Arrays in, plain numbers out."""

from evis.events.measure.measurement import Measurement

__all__ = ["Measurement"]
