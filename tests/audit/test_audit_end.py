"""Why an audit ends: who was reset."""

from __future__ import annotations

import numpy as np
import pytest

from nodes.audit.node import _who_is_reset


@pytest.mark.parametrize(
    ("origins", "said"),
    [
        ([5, 5, 5], "all environments are reset while the run goes on"),
        ([0, 5, 0], "an environment is reset by itself"),
        ([5], "the environment is reset while the run goes on"),
    ],
)
def test_it_is_said_who_was_reset(origins: list[int], said: str) -> None:
    own = np.zeros((len(origins), 4), np.int64)
    own[:, 1] = origins
    assert _who_is_reset(own) == said
