"""Computes what comes before the threshold: defocus and the photoreceptor."""
