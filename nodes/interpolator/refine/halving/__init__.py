"""Halves the intervals between two samples of a pixel until ln I is straight between samples."""
