"""The event sensor: linear luminance in, events out."""
