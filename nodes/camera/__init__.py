"""Publishes the events of a real event camera, or of a recording of one, on the same topics as the simulator."""
