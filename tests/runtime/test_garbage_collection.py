"""The collector of cycles does not look while things are made, and is afterwards as it was."""

import gc

import pytest

from evis.runtime.process.garbage_collection import without_garbage_collection


@pytest.mark.parametrize("on", [True, False])
def test_the_collector_is_afterwards_as_it_was(on: bool) -> None:
    before = gc.isenabled()
    (gc.enable if on else gc.disable)()
    try:
        with pytest.raises(ValueError, match="made nothing"), without_garbage_collection():
            assert not gc.isenabled()
            raise ValueError("made nothing")
        assert gc.isenabled() == on
    finally:
        (gc.enable if before else gc.disable)()
