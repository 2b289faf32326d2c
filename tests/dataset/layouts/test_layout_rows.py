"""Events by number and stamps of labels, of every layout, beside those by time and the simulation's own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sequences import DURATION_NS, events_of, labels_of, simulated, written

import evis
from evis.dataset.layouts import LAYOUTS, LayoutError, reader_of

US = ("dsec",)


@pytest.mark.parametrize("jitter_us", [0.0, 200.0])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_rows_stamps_and_the_folder_by_itself(layout: str, jitter_us: float, tmp_path: Path) -> None:
    """Layouts that keep rows, and those that have to count them, also where a readout delays events past the end; a
    folder says itself which layout it is in.
    """
    if layout == "zarr":
        pytest.importorskip("zarr", reason="zarr is not installed: make test-extras")
    about, steps = simulated(**({"timestamp_jitter_us": jitter_us} if jitter_us else {}))
    written(layout, tmp_path / "s", about, steps)
    reader = reader_of(layout)(tmp_path / "s")
    whole, truth = reader.events(0, 10**12), events_of(steps, "cam0")
    count = len(truth["t"])
    assert (truth["t"][-1] > DURATION_NS) == (jitter_us > 0)
    for first, end in ((0, count), (0, 1), (count - 1, count), (137, 2500), (2500, 2500), (count // 2, count)):
        got = reader.rows(first, end)
        for name in "txyp":
            assert np.array_equal(getattr(got, name), getattr(whole, name)[first:end]), (first, end)
    for kind in reader.kinds("cam0"):
        got = reader.stamps(kind)
        if kind in ("forward_flow", "backward_flow"):
            want = np.array(labels_of(steps, "cam0", "flow_t")[1])
        elif kind == "events":
            want = np.stack((truth["t"], truth["t"]), -1)
        else:
            name = {"boxes": "box", "poses": "pose", "boxes3d": "box3d_id"}.get(kind, kind)
            want = np.tile(labels_of(steps, "cam0", name)[0][:, None], (1, 2))
        want = want // 1000 * 1000 if layout in US else want
        # What DSEC and MVSEC have of flow begins with the first interval, at keyframe 1.
        assert np.array_equal(got, want[len(want) - len(got) :]) and len(want) - len(got) <= 1, kind
    with pytest.raises(LayoutError, match="no labels 'smell' of cam0; it has"):
        reader.stamps("smell")

    data = evis.dataset.open(tmp_path / "s")
    assert len(data) == 1 and data[0].name == about.name and data[0].seed == about.seed
    assert np.array_equal(data[0].events().t, whole.t)
    assert data[0].kinds() == reader.kinds("cam0")
    windows = data.windows(seconds=1 / 30, labels=["boxes"] if layout != "mvsec" else ["depth"])
    assert len(windows) == 4 and sum(len(w["events"]["t"]) for w in windows) == count - np.count_nonzero(
        whole.t >= windows[3]["t1_ns"]
    )
