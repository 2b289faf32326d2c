"""A data set that lies where fsspec reaches is read as one on this machine."""

from __future__ import annotations

from pathlib import Path

import pytest
from made_set import same

import evis
from evis.dataset.loading.copies import copied

pytestmark = pytest.mark.extras


def test_sequences_are_copied_once(small: tuple[Path, Path]) -> None:
    """Those that are used, and no others."""
    pytest.importorskip("fsspec", reason="fsspec is not installed: make test-extras")
    place = f"file://{small[1]}"
    there, here = evis.dataset.open(place), evis.dataset.open(small[1])
    assert [s.arguments for s in there] == [s.arguments for s in here] and there.splits == here.splits
    before = copied.cache_info().currsize
    windows = there[1:2].windows(seconds=1 / 30, labels=["forward_flow", "boxes"])
    for a, b in zip(windows, here[1:2].windows(seconds=1 / 30, labels=["forward_flow", "boxes"]), strict=True):
        same(a, b)
    assert there[1].folder != here[1].folder
    assert copied.cache_info().currsize - before == 1
