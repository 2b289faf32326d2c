"""Keeps the arrays of messages: slots of host memory and of a GPU, seen from this process and from others."""
