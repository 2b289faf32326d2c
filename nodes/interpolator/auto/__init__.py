"""`auto`: measures the cost and the error of every way to run a scene, and chooses."""
