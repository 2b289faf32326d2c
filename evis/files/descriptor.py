"""Closes the descriptor by which a reader has its file open."""

from __future__ import annotations

import os


class DescriptorOwner:
    """Owns the descriptor of a file that is read at places, by `os.pread`."""

    _descriptor = -1
    """Negative while there is none."""

    def close(self) -> None:
        """Closes the file; once more does nothing."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1
