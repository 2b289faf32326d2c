"""Starts the processes of a plan, watches them, ends them in order, and leaves nothing behind."""
