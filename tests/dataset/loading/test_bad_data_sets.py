"""What cannot be read or made is told in one line that names it and the remedy."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_set import made

import evis
from evis.dataset import Augment
from evis.dataset.bag_sequence import export
from evis.dataset.errors import DatasetError
from evis.dataset.report.summary import summary
from evis.dataset.report.verify import verify

Made = tuple[Path, Path]


def refusal(what: Callable[..., Any], *args: Any, **how: Any) -> str:
    """The one line with which a call is refused."""
    with pytest.raises(DatasetError) as caught:
        what(*args, **how)
    text = str(caught.value)
    assert "\n" not in text and len(text) < 400
    return text


def test_no_data_set(tmp_path: Path) -> None:
    assert "evis dataset make" in refusal(lambda: evis.dataset.open(tmp_path / "none"))
    assert f"{tmp_path} holds no data set" in refusal(lambda: evis.dataset.open(tmp_path))
    (tmp_path / "dataset.json").write_text("{")
    assert "dataset.json is damaged" in refusal(lambda: evis.dataset.open(tmp_path))
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / "about.json").write_text("{}")
    assert "make the sequence anew" in refusal(lambda: evis.dataset.open(tmp_path / "s"))


def test_a_recording_is_no_data_set(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(b"")
    assert "run.mcap is a file, and a data set is a folder; evis.open reads" in refusal(
        lambda: evis.dataset.open(tmp_path / "run.mcap")
    )


def test_sequences_that_are_not_there(small: Made) -> None:
    data: Any = evis.dataset.open(small[1])
    for which in (3, -4, [0, 3]):
        with pytest.raises(IndexError, match=r"there is no sequence -?[34]; there are 3"):
            data[which]
    for which in ("spinning_disk_00001", 0.5, [0.5], ["a"]):
        with pytest.raises(TypeError, match="by number, slice or a list of numbers, not by"):
            data[which]
    for mask in ([True, False, True], np.array([True, False, True])):
        with pytest.raises(TypeError, match=r"not by a mask; np\.flatnonzero"):
            data[mask]


def test_labels_of_events_that_are_not_there(tmp_path: Path) -> None:
    """They are missed when windows are asked for, as all others are, and not when the first one is read."""
    with evis.Simulation("spinning_disk", outputs=["events", "info"], width=32, height=24) as sim:
        sim.run(0.1)
        sim.save(tmp_path / "a.mcap")
    export(tmp_path / "a.mcap", "npz", tmp_path / "s")
    data = evis.dataset.open(tmp_path / "s")
    assert "has no labels 'events' of cam0" in refusal(data.windows, seconds=0.05, labels=["events"])


def test_flow_that_turned_time_would_be_made_of(tmp_path: Path) -> None:
    """Nobody asked for the label that is missed; why it is needed is told."""
    data = evis.dataset.open(made(tmp_path, ("backward_flow, ", ""))[1])
    text = refusal(data.windows, seconds=1 / 30, labels=["forward_flow"], augment=Augment(reverse=0.5))
    assert "has no labels 'backward_flow'" in text
    assert text.endswith("Where `reverse` turns time round, forward_flow is made of backward_flow")


def test_windows_that_cannot_be(small: Made) -> None:
    data = evis.dataset.open(small[1])
    cases: list[tuple[dict[str, Any], str]] = [
        ({}, "seconds=0.05 or events=20000"),
        ({"seconds": 1, "events": 5}, "one of them"),
        ({"seconds": 0}, "the window is 0 s"),
        ({"seconds": float("nan")}, "the window is nan s"),
        ({"events": 2.5}, "the window is 2.5 events; it must be more than 0, and whole"),
        ({"seconds": 0.1, "stride": -1}, "the stride is -1 s"),
        ({"seconds": 3}, "windows of 3 s are longer than any sequence"),
        ({"events": 10**7}, "windows of 10000000 events are longer than any sequence"),
        ({"seconds": 0.1, "representation": "voxelgrid"}, "did you mean 'voxel_grid'?"),
        ({"seconds": 0.1, "representation": "voxel_grid"}, "missing 1 required positional argument: 'bins'"),
        ({"seconds": 0.1, "representation": "voxel_grid", "bin": 5}, "has no option 'bin'; did you mean 'bins'?"),
        ({"seconds": 0.1, "representation": "voxel_grid", "bins": 0}, "bins is 0; it must be a whole number"),
        ({"seconds": 0.1, "bins": 5}, "no argument 'bins', or it needs a representation="),
        ({"seconds": 0.1, "labels": "depth"}, "labels and arguments are lists"),
        ({"seconds": 0.1, "labels": None}, "labels and arguments are lists"),
        ({"seconds": 0.1, "representation": 3}, "there is no representation '3'"),
        ({"seconds": 0.1, "labels": ["flwo"]}, "has no labels 'flwo' of cam0; it has depth, "),
        ({"seconds": 0.001, "stride": 0.05, "labels": ["depth"]}, "which come 30 times a second; make windows longer"),
        ({"events": 100, "labels": ["events"]}, "take windows by seconds="),
        ({"seconds": 0.1, "camera": "cam7"}, "has no camera 'cam7'; it has cam0"),
        ({"seconds": 0.1, "augment": Augment(flip_x=2)}, "it is a share, from 0 to 1"),
        ({"seconds": 0.1, "augment": Augment(flip_x="half")}, "flip_x of Augment is 'half'; it is a share"),  # type: ignore[arg-type]
        ({"seconds": 0.1, "augment": Augment(crop=5)}, "crop of Augment is 5; it is (height, width)"),  # type: ignore[arg-type]
        (
            {"seconds": 0.1, "augment": 0.5},
            "augment is 0.5; it is an Augment: augment=evis.dataset.Augment(flip_x=0.5)",
        ),
        ({"seconds": 0.1, "seed": "a"}, "seed is 'a'; it must be a whole number"),
        ({"seconds": 1e-10}, "the window is 1e-10 s; it must be 1e-06 s or more"),
        ({"seconds": 0.1, "stride": 1e-9}, "the stride is 1e-09 s; it must be 1e-06 s or more"),
        ({"seconds": 0.1, "augment": Augment(noise=-1)}, "a rate per pixel, 0 Hz or more"),
        ({"seconds": 0.1, "augment": Augment(crop=(0, 4))}, "it is (height, width) in pixels"),
        ({"seconds": 0.1, "augment": Augment(flip_y=0.5), "labels": ["poses"]}, "a mirrored image has no poses"),
    ]
    for how, text in cases:
        assert text in refusal(data.windows, **how), how
    assert "has no labels 'depht' of cam0; it has" in refusal(lambda: data[0].labels("depht"))
    assert "no split 'trian'; did you mean 'train'?" in refusal(lambda: data.split("trian"))
    assert "has no camera 'cam1'" in refusal(lambda: data[0].events(camera="cam1"))
    assert "crops are smaller" in refusal(lambda: data.windows(seconds=0.1, augment=Augment(crop=(999, 9)))[0])
    for size in (0, 2.5):
        many = data.windows(seconds=0.1).batches(size)  # type: ignore[arg-type]
        assert f"batches are of {size} windows; it must be a whole number, 1 or more" in refusal(next, many)
    wrong = data.windows(seconds=0.1, arguments=["omgea"])
    assert "has no argument 'omgea' in its recipe; it has width" in refusal(lambda: wrong[0])


def test_a_file_that_is_cut(small: Made, tmp_path: Path) -> None:
    """Of every kind that is read in parts; the rest of the data set can still be read."""
    for name in ("cam0/events.npz", "cam0/depth.npz"):
        shutil.copytree(small[1], tmp_path / name)
        data = evis.dataset.open(tmp_path / name)
        path = data[1].folder / name
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        text = refusal(lambda data=data: list(data[1:2].windows(seconds=0.05, labels=["depth"])))
        assert str(path) in text or data[1].name in text
        assert "make the sequence anew" in text or "evis dataset verify" in text
        assert len(data[2:].windows(seconds=0.05, labels=["depth"])[0]["depth"]) > 0


def test_a_cut_hdf5_file(tmp_path: Path) -> None:
    """h5py tells of it in words of its own."""
    _, out = made(tmp_path, ("layout: npz", "layout: dsec"), ("sequences: 3", "sequences: 1"), (", events]", "]"))
    data = evis.dataset.open(out)
    path = data[0].folder / "events/left/events.h5"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    text = refusal(lambda: data.windows(seconds=0.05)[0])
    assert data[0].name in text and "cannot be read" in text and "make the sequence anew" in text


def test_a_compression_that_is_not_installed(small: Made) -> None:
    """HDF5 says it so, and a file that is not damaged is not called so."""
    sequence = evis.dataset.open(small[1])[0]

    def read() -> None:
        with sequence.readable():
            raise OSError("Can't synchronously read data (can't open directory (/usr/local/lib/plugin))")

    text = refusal(read)
    assert "pip install 'evis[files]'" in text and "damaged" not in text


def test_without_pytorch(small: Made, monkeypatch: pytest.MonkeyPatch) -> None:
    """numpy's iterators are named instead."""
    for name in [name for name in sys.modules if name.endswith((".torch_data", ".torch_stream"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)
    windows = evis.dataset.open(small[1]).windows(seconds=0.05)
    for call in (windows.torch, windows.torch_iterable):
        assert "pip install torch; without it go over `.batches(32)`" in refusal(call)
    how = {"sequences": 1, "seconds": 0.1}
    assert "pip install torch" in refusal(lambda: evis.dataset.stream(small[0], arrays="torch", **how))
    assert len(list(evis.dataset.stream(small[0], **how).batches(2))) == 1


def test_streams_that_cannot_be(small: Made) -> None:
    cases: list[tuple[dict[str, Any], str]] = [
        ({"seconds": 0.1, "labels": ["flow"]}, "small makes no labels 'flow'; it makes backward_flow, "),
        ({"seconds": 2}, "windows of 2 s are longer than the sequences of small, 0.2 s"),
        ({"seconds": 0.1, "split": "tset"}, "has no split 'tset'; did you mean 'test'?"),
        ({"seconds": 0.1, "arrays": "jax"}, "it is torch or numpy"),
        ({"seconds": 0.1, "representation": "time_surfac"}, "did you mean 'time_surface'?"),
        ({"seconds": 0.1, "sequences": -1}, "sequences is -1; it must be a whole number, 0 or more"),
        ({"seconds": 0.1, "first": 1.5}, "first is 1.5; it must be a whole number, 0 or more"),
        ({"seconds": 0.1, "shuffle": -3}, "shuffle is -3; it must be a whole number, 0 or more"),
        ({"seconds": 0.1, "arrays": "numpy", "rank": 2, "ranks": 2}, "rank is 2 of 2 ranks; they are numbered from 0"),
        ({"seconds": 0.1, "arrays": "numpy", "rank": 1}, "rank and ranks are given together"),
    ]
    for how, text in cases:
        assert text in refusal(evis.dataset.stream, small[0], **how), how
    empty = small[0].with_name("empty_split.yaml")
    empty.write_text(small[0].read_text().replace("{train: 0.6, test: 0.4}", "{train: 1, test: 0}"))
    assert "'test' of empty_split has a share of 0" in refusal(evis.dataset.stream, empty, seconds=0.1, split="test")
    never = evis.dataset.stream(small[0], arrays="numpy", events=10**8)
    assert "5 sequences in a row gave no window" in refusal(lambda: next(iter(never)))
    few = evis.dataset.stream(small[0], arrays="numpy", sequences=1, events=10**8)
    assert "none of 1 sequences gave a window: spinning_disk_00000 is shorter than a window of" in refusal(list, few)


def test_a_dataset_json_that_evis_did_not_write(small: Made, tmp_path: Path) -> None:
    """What it lacks is named, and it leads to no other folder."""
    whole = json.loads((small[1] / "dataset.json").read_text())
    first, *others = whole["sequences"]
    cases: list[tuple[dict[str, Any], str]] = [
        ({"sequences": [first | {"path": "../../other"}, *others]}, "'../../other' leads out of its folder"),
        ({"sequences": [first | {"path": "/etc"}]}, "'/etc' leads out of its folder"),
        ({"sequences": [first | {"files": {"../../other": "0"}}]}, "'../../other' leads out of its folder"),
        ({"sequences": [*others, 3]}, "sequence 2 is no map"),
        ({"sequences": [first | {"events": "many"}]}, "sequence 0 has the events 'many'"),
        ({"sequences": None}, "it has the sequences None"),
        ({"recipe": {}}, "its recipe has no name"),
    ]
    for change, told in cases:
        (tmp_path / "dataset.json").write_text(json.dumps(whole | change))
        for read in (evis.dataset.open, summary, verify):
            text = refusal(read, str(tmp_path))
            assert told in text and text.startswith(f"{tmp_path}: dataset.json is damaged"), text
    (tmp_path / "dataset.json").write_text("[" * 100_000)
    assert "dataset.json is damaged" in refusal(summary, str(tmp_path))
