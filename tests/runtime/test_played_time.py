"""How much time a node has played, over rounds of a recording and episodes of a simulation."""

import numpy as np
import pytest

from evis.runtime.profile import NodeProfile
from msgs.camera import CameraInfo
from msgs.header import Header
from msgs.world import Clock

MS = 1_000_000


def played(moments):
    """Time [ms] and the newest stamp [ms], for messages at (stamp [ms], episode)."""
    profile = NodeProfile()
    for stamp, episode in moments:
        profile.saw("/clock", Clock(Header(stamp * MS, episode=episode)))
    return (profile.stamp_ns - profile.first_stamp_ns) / MS, profile.stamp_ns / MS


@pytest.mark.parametrize(
    ("moments", "expected"),
    [
        ([(100, 0), (130, 0), (200, 0)], (100, 200)),
        ([(100, 0), (200, 0), (100, 1), (150, 1)], (150, 150)),
        ([(0, 0), (300, 0), (0, 1), (300, 1), (0, 2), (300, 2)], (900, 300)),
        ([(0, 0), (50, 0), (60, 1), (90, 2)], (90, 90)),
        ([(50, 0), (40, 0), (60, 0)], (10, 60)),
    ],
)
def test_rounds_add_up_and_resets_change_nothing(moments, expected):
    assert played(moments) == expected


def test_a_description_from_before_the_part_that_is_played_does_not_count():
    profile = NodeProfile()
    profile.saw("/cam0/info", CameraInfo(Header(0), k=np.eye(3), distortion=np.zeros(0), width=3))
    for stamp in (100, 200):
        profile.saw("/clock", Clock(Header(stamp * MS)))
    assert profile.stamp_ns - profile.first_stamp_ns == 100 * MS
