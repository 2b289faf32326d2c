"""Names what `zipfile` raises for an archive that is damaged, cut or of a kind it does not read."""

from __future__ import annotations

import zipfile
import zlib

UNREADABLE = (zipfile.BadZipFile, OSError, NotImplementedError)
"""Where an archive is opened."""
ZIP_FAULTS = (*UNREADABLE, zlib.error, EOFError, RuntimeError)
"""Where a member is read as well; RuntimeError for one that needs a password."""
