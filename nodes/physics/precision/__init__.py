"""Measures the error of a simulated trajectory, and shortens steps to keep it within a tolerance."""
