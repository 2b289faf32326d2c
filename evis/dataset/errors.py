"""What goes wrong with a data set."""

from __future__ import annotations


class DatasetError(ValueError):
    """Says in one line what of a data set cannot be done, and what to do."""
