"""The launch file of the graph of four processes."""

from __future__ import annotations

from pathlib import Path

import pytest
from running_chain import CHAIN, Write


@pytest.fixture
def chain(write: Write) -> Path:
    return write(CHAIN)
