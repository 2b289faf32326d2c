"""Reads and writes files safely: whole or not at all, within an allowance, with errors that name them."""
