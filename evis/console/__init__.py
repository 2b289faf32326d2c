"""Handles how the program talks to its user and is stopped: streams that cannot fail, Ctrl-C, SIGTERM, printable
text."""
