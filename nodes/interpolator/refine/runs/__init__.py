"""Finds the runs of one surface that each pixel shows in a window, and lists the samples that each run needs."""
