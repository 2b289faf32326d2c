"""Every layout gives back the events and labels of a simulation, by its own reader; others' readers are beside it."""

from __future__ import annotations

import dataclasses
import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sequences import DURATION_NS, EVERY, events_of, labels_of, simulated, written

import evis
from evis.dataset.about import About
from evis.dataset.layouts import LayoutError, reader_of, writer_of
from evis.dataset.layouts.sample import DENSE, ENVIRONMENT_AXIS, EVENTS, TABLES

EXACT = {"npz": 1, "zarr": 1, "webdataset": 1, "mcap": 1, "coco": 1, "mvsec": 1, "dsec": 1000}
"""Layouts, and what their times are multiples of [ns]."""
WHOLE = ("npz", pytest.param("zarr", marks=pytest.mark.extras), "webdataset", "mcap")
"""Layouts that hold every kind of label."""


@pytest.fixture(params=EVERY)
def layout(request: Any) -> str:
    return str(request.param)


def test_every_event_comes_back(layout: str, tmp_path: Path) -> None:
    """All of them, and those of windows that cut packets and milliseconds apart."""
    about, steps = simulated()
    written(layout, tmp_path / "s", about, steps)
    reader, want = reader_of(layout)(tmp_path / "s"), events_of(steps, "cam0")
    want["t"] = want["t"] // EXACT[layout] * EXACT[layout]
    assert reader.count == len(want["t"]) > 4000 and reader.duration_ns == DURATION_NS
    windows = [(0, 10**12), (0, 1), (7_123_000, 61_987_000), (33_333_000, 66_667_000), (50_000_000, 50_000_000)]
    windows += [(130_000_000, 10**12), (-5, 3_000_000), (10**12, 10**13)]
    for t0, t1 in windows:
        got, part = reader.events(t0, t1), (want["t"] >= t0) & (want["t"] < t1)
        for name in "txyp":
            assert getattr(got, name).dtype == want[name].dtype, name
            assert np.array_equal(getattr(got, name), want[name][part]), (name, t0, t1)


@pytest.mark.parametrize("layout", WHOLE)
def test_every_label_comes_back(layout: str, tmp_path: Path) -> None:
    """To the bit, with its stamps."""
    about, steps = simulated()
    written(layout, tmp_path / "s", about, steps)
    reader = reader_of(layout)(tmp_path / "s")
    assert set(reader.kinds("cam0")) == set(about.labels)
    for kind in about.labels:
        got = reader.labels(kind, 0, 10**12)
        for name in (*DENSE.get(kind, ()), *TABLES.get(kind, ()), *(EVENTS if kind == "events" else ())):
            stamps, want = labels_of(steps, "cam0", name)
            assert want, name
            if kind in DENSE:
                assert np.array_equal(got["t"], stamps)
                want = [array[0] if name in ENVIRONMENT_AXIS else array for array in want]
                assert got[name].tobytes() == np.stack(want).tobytes(), name
            else:
                assert got[name].tobytes() == np.concatenate(want).tobytes(), name
            if kind in TABLES:
                assert np.array_equal(np.diff(got["offsets"]), [len(array) for array in want])
    assert np.array_equal(reader.labels("events", 0, 10**12)["t"], events_of(steps, "cam0")["t"])
    one = reader.labels("depth", 66_666_667, 66_666_668)
    assert one["t"].tolist() == [66_666_667] and one["depth"].shape == (1, 48, 64)
    assert reader.labels("boxes", 5, 6)["box"].shape == (0, 4)
    assert reader.about.bodies and len(reader.about.bodies) == reader.labels("poses", 0, 10**12)["pose"].shape[1]


@pytest.mark.parametrize("layout", WHOLE)
def test_labels_of_events_come_back_in_parts(layout: str, tmp_path: Path) -> None:
    """A row for each event of the interval, also of one that ends among the last events of the run."""
    about, steps = simulated()
    written(layout, tmp_path / "s", about, steps)
    reader, t = reader_of(layout)(tmp_path / "s"), events_of(steps, "cam0")["t"]
    want = {name: np.concatenate(labels_of(steps, "cam0", name)[1]) for name in EVENTS}
    for t0, t1 in [(0, 5_000_000), (20_000_000, 70_000_000), (90_000_000, 120_000_000), (101_000_000, DURATION_NS)]:
        got, part = reader.labels("events", t0, t1), (t >= t0) & (t < t1)
        assert part.any() and np.array_equal(got["t"], t[part]), (t0, t1)
        for name in EVENTS:
            assert got[name].tobytes() == want[name][part].tobytes(), (name, t0, t1)


def test_what_is_known_of_a_sequence_comes_back(layout: str, tmp_path: Path) -> None:
    """The cameras too."""
    about, steps = simulated()
    written(layout, tmp_path / "s", about, steps)
    got = reader_of(layout)(tmp_path / "s").about
    for field in dataclasses.fields(About):
        if field.name not in ("cameras", "bodies", "layout", "counts"):
            assert getattr(got, field.name) == getattr(about, field.name), field.name
    assert got.layout == layout and got.counts == {"cam0": len(events_of(steps, "cam0")["t"])}
    info, kept = about.cameras["cam0"], got.cameras["cam0"]
    assert np.array_equal(kept.k, info.k) and kept.instances == info.instances and kept.sensor == info.sensor
    assert kept.semantic is not None and kept.semantic.dtype == np.int32


def test_the_same_steps_make_the_same_bytes(layout: str, tmp_path: Path) -> None:
    """Of every file."""
    about, steps = simulated()
    for name in "ab":
        written(layout, tmp_path / name, about, steps)
    files = {name: _hashes(tmp_path / name) for name in "ab"}
    assert files["a"] == files["b"] and len(files["a"]) > 1
    assert not [path for path in files["a"] if ".part" in path]


def _hashes(folder: Path) -> dict[str, str]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {p.relative_to(folder).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def test_a_sequence_without_events_is_one(layout: str, tmp_path: Path) -> None:
    """Nothing moves, nothing is lost: windows are empty, and the index is there."""
    about, steps = simulated("spinning_disk", "depth", threshold=5.0)
    assert not len(events_of(steps, "cam0")["t"])
    written(layout, tmp_path / "s", about, steps)
    reader = reader_of(layout)(tmp_path / "s")
    assert reader.count == 0 and len(reader.events(0, 10**12).t) == 0


def test_what_goes_wrong_is_said_in_one_line(tmp_path: Path) -> None:
    """A folder that is not empty, an unknown layout, camera or kind, events out of order, several environments."""
    about, steps = simulated()
    with pytest.raises(LayoutError, match=r"no layout 'dsek'; .*dsec"):
        writer_of("dsek")
    written("npz", tmp_path / "s", about, steps)
    with pytest.raises(LayoutError, match="s is not empty; a sequence goes into a folder of its own"):
        writer_of("npz")(tmp_path / "s", about)
    nobody: Any = {"cam0": None}
    with pytest.raises(LayoutError, match="a has no CameraInfo of cam0"):
        writer_of("npz")(tmp_path / "v", dataclasses.replace(about, cameras=nobody))
    reader = reader_of("npz")(tmp_path / "s")
    with pytest.raises(LayoutError, match="no camera 'cam7'; it has cam0"):
        reader.events(0, 1, "cam7")
    with pytest.raises(LayoutError, match="no labels 'contacts' of cam0; it has "):
        reader.labels("contacts", 0, 1)
    with pytest.raises(LayoutError, match=r"is no sequence that evis wrote: it has no about\.json"):
        reader_of("npz")(tmp_path)
    writer = writer_of("npz")(tmp_path / "t", about)
    writer.add(steps[2])
    with pytest.raises(LayoutError, match="step back in time"):
        writer.add(steps[1])
    with evis.Simulation("spinning_disk", width=32, height=24, envs=2) as sim:
        sim.reset()
        with pytest.raises(LayoutError, match="one environment, the step has 2"):
            writer_of("npz")(tmp_path / "u", about).add(sim.step())
