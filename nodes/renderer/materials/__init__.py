"""Computes how surfaces reflect: the GGX model and its tables."""
