"""Defines the errors that data sets raise."""

from __future__ import annotations

import errno
import os

HOPELESS = (errno.ENOSPC, errno.EDQUOT, errno.EACCES, errno.EPERM, errno.EROFS)
"""Faults of the place that is written to: nothing else can be written there either."""


class DatasetError(ValueError):
    """Says in one line what of a data set cannot be done, and what to do."""


def refused_by_place(error: BaseException) -> int:
    """Returns the number of a fault for which nothing else can be written to a place either; 0 for any other error."""
    if isinstance(error, OSError) and error.errno in HOPELESS:
        return error.errno
    # HDF5 says it in the text alone.
    return next((number for number in HOPELESS[:2] if os.strerror(number) in str(error)), 0)
