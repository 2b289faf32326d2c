"""Finds when light changes between two frames: lamps that flicker, shadows and beams that pass."""
