"""The event model: a pixel's state, its thresholds, crossing times, noise; for any device."""
