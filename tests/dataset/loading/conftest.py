"""The data set that these tests read, made once."""

from __future__ import annotations

from pathlib import Path

import pytest
from made_set import made


@pytest.fixture(scope="session")
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Recipe and folder of a data set that nobody writes into."""
    return made(tmp_path_factory.mktemp("loading"))
