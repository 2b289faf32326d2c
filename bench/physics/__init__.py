"""Measures error against run time of the dynamics, on cases whose course is known, by integrator and time step.

Trials that fail stay in the tables.
"""
