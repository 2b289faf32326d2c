"""Divides environments into shares: which has which, messages of some of them, and such messages as one of all."""
