"""The camera node: a real event camera, or a recording of one, on the same topics as the simulator."""
