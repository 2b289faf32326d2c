"""A recording whose first event is at 0: the interval that holds it begins before, where a bag has no times."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np

from evis.events import Events, open_recording, open_writer


def test_recording_that_begins_at_zero_is_recorded_whole(tmp_path):
    events = Events.of(np.arange(5) * 7_000_000, [0, 1, 2, 3, 4], [4, 3, 2, 1, 0], [1, 0, 1, 0, 1])
    with open_writer(tmp_path / "a.npz", 8, 6) as writer:
        writer.write(events)
    command = ["launch", "camera", "file:=a.npz", "pace:=fast", "--no-view", "--record", "a.mcap"]
    done = subprocess.run(
        [sys.executable, "-m", "evis", *command],
        cwd=tmp_path,
        env={**os.environ, "XDG_RUNTIME_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    with open_recording(tmp_path / "a.mcap") as recording:
        blocks = list(recording.blocks())
    for name in ("t", "x", "y", "p"):
        np.testing.assert_array_equal(np.concatenate([getattr(b, name) for b in blocks]), getattr(events, name))
