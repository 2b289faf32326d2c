"""Draws the contents of panels: each view takes a topic's messages on one thread and makes what the page draws on
another.
"""
