"""How the sensor's work is laid out on a CPU."""
