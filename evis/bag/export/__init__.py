"""Exports single topics of a bag as files of their own."""
