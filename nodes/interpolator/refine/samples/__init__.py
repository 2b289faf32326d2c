"""Holds the lists of samples: they grow and are counted on the device, and the sensor gets them in order."""
