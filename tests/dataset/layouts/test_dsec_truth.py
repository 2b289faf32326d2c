"""DSEC's layout against a closed form: flow and boxes of a card that flies by, and the index of sparse events."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import h5py
import known_motion
import numpy as np
import pytest
from sequences import events_of, simulated, written

from evis.dataset.layouts import reader_of
from evis.events.arrays import Events
from evis.events.files.hdf5.dsec_events import EventFile

SIZE = (64, 48)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: Any) -> Path:
    about, steps = simulated(known_motion.SCENE, "forward_flow", "backward_flow", "boxes")
    return Path(written("dsec", tmp_path_factory.mktemp("dsec") / "s", about, steps).directory)


@pytest.mark.parametrize("way", ["forward", "backward"])
def test_flow_is_that_of_the_motion(folder: Path, way: str) -> None:
    """On the card it is the projection's, on the wall 0; to what 16 bit tell, at the times that the text says."""
    spans = np.loadtxt(folder / f"flow/{way}_timestamps.txt", np.int64, delimiter=",")
    files = sorted((folder / "flow" / way).glob("*.png"))
    assert len(spans) == len(files) == 4 and (np.sign(np.diff(spans)) == (1 if way == "forward" else -1)).all()
    for path, (start, end) in zip(files, (spans * 1000).tolist()):
        codes = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., ::-1]
        want, card = known_motion.flow(start, end, *SIZE)
        valid = codes[..., 2] == 1
        got = (codes[..., :2].astype(float) - 2**15) / 128
        # A stamp is off by up to 1 us here: 0.3 mpx at 300 px/s.
        assert np.abs(got - want)[valid].max() <= 0.5 / 128 + 1e-3
        assert valid[card].all() and valid[~card].any() and not valid.all()  # what the card covers is not
        assert np.hypot(*want[card].T).min() > 2


def test_boxes_are_those_of_the_projection(folder: Path) -> None:
    """The card's: of the pixels whose centres its image covers, by class and instance."""
    rows = np.load(folder / "object_detections/left/tracks.npy")
    assert rows.dtype == [
        ("t", "<u8"), ("x", "<f8"), ("y", "<f8"), ("h", "<f8"), ("w", "<f8"), ("class_id", "u1"),
        ("class_confidence", "<f8"), ("track_id", "<u8"),
    ]  # fmt: skip
    cards = rows[rows["class_id"] == known_motion.CAR - 1]
    assert len(cards) == 5 and len(np.unique(cards["track_id"])) == 1
    assert cards["t"].tolist() == [0, 33_333, 66_666, 100_000, 133_333]
    for row in cards:
        x0, y0, x1, y1 = known_motion.box(int(row["t"]) * 1000, *SIZE)
        assert [row["x"], row["y"], row["w"], row["h"]] == [x0, y0, x1 - x0 + 1, y1 - y0 + 1]


def test_events_are_where_the_card_is(folder: Path) -> None:
    """None is further from the card than from where it was or will be within the sequence."""
    about, steps = simulated(known_motion.SCENE, "forward_flow", "backward_flow", "boxes")
    want = events_of(steps, "cam0")
    got = reader_of("dsec")(folder).events(0, about.duration_ns)
    assert len(got.t) == len(want["t"]) > 300
    for t, x, y in zip(got.t.tolist(), got.x.tolist(), got.y.tolist()):
        left, top, right, bottom = known_motion.edges(t, *SIZE)
        assert left - 1 <= x <= right + 1 and top - 1 <= y <= bottom + 1


SPARSE = {
    "none": [],
    "one, late": [41_000_000],
    "on the marks": [1_000_000, 2_000_000, 2_000_000, 5_000_000],
    "just before and after": [999_999, 1_000_000, 1_000_001, 1_999_999, 2_000_999],
    "gaps": [0, 500_000, 2_100_000, 5_000_000, 5_000_000, 7_100_000, 7_200_000, 7_200_000, 8_100_000, 9_000_000],
    "beyond the end": [3_000_000, 17_500_000],
}
"""Times of events [ns] from the start; 'gaps' is the example of DSEC's event slicer."""


@pytest.mark.parametrize("offset_us", [0, 49_599_300_523])
@pytest.mark.parametrize("times", SPARSE.values(), ids=list(SPARSE))
@pytest.mark.parametrize("packet", [1, 3, 100])
def test_the_index_keeps_its_definition(tmp_path: Path, times: list[int], offset_us: int, packet: int) -> None:
    """t[idx[ms]] >= 1000 ms > t[idx[ms] - 1] for every millisecond, empty ones too, in packets of any size."""
    t = np.array(times, np.int64) + offset_us * 1000
    file = EventFile(tmp_path / "events.h5", offset_us)
    for k in range(0, max(len(t), 1), packet):
        part = t[k : k + packet]
        file.add(Events(part, *(np.zeros(len(part), dtype) for dtype in (np.uint16, np.uint16, np.uint8))))
    file.finish(offset_us * 1000 + 10_500_000)
    with h5py.File(tmp_path / "events.h5") as read:
        us, index, offset = read["events/t"][:].astype(np.int64), read["ms_to_idx"][:], int(read["t_offset"][()])
    assert offset == offset_us and np.array_equal(us, np.array(times, np.int64) // 1000)
    assert len(index) == max(11, max(times, default=0) // 1_000_000 + 1) + 1
    for ms, k in enumerate(index.tolist()):
        assert k == len(us) or us[k] >= 1000 * ms
        assert k == 0 or us[k - 1] < 1000 * ms
    if times == SPARSE["gaps"]:
        assert index[:10].tolist() == [0, 2, 2, 3, 3, 3, 5, 5, 8, 9]
