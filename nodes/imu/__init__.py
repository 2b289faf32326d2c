"""Simulates the inertial measurement unit of a camera: specific force and angular velocity from the motion of its
body."""
