"""Real recordings and what is known about them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from real_recordings import DATA


@pytest.fixture(scope="session")
def truth() -> dict[str, Any]:
    """What independent readers found in each recording."""
    path = DATA / "ground_truth.json"
    if not path.exists():
        pytest.skip(f"no recordings at {DATA} (set EVIS_TEST_DATA)")
    return json.loads(path.read_text())["files"]


@pytest.fixture(scope="session")
def recording_path(truth: dict[str, Any]) -> Any:
    """Path of a recording of the ground truth."""

    def find(name: str) -> Path:
        path = DATA / name
        if not path.exists():
            pytest.skip(f"{path} is not there")
        return path

    return find
