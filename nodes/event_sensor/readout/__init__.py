"""Computes what comes after the threshold: the order of events, and the readout's delays."""
