"""Where the real recordings are that the tests of decoders and readers go by."""

from __future__ import annotations

import os
from pathlib import Path

DATA = Path(os.environ.get("EVIS_TEST_DATA", Path(__file__).parents[3] / "shared" / "data"))
