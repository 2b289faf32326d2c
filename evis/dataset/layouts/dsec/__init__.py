"""Writes and reads DSEC, with DSEC-Det: a folder as one of its sequences."""
