"""Measures how long data sets take to make, how many bytes they keep, and how fast they are read."""
