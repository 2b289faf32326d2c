"""What a reader says of files that are cut, missing or of another layout, and of packages that are not installed."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from in_this_process import InThisProcess
from sequences import EVERY, framed, simulated, written
from small_recipe import write

from evis.dataset.layouts import LayoutError, reader_of
from evis.dataset.making.make import make
from evis.dataset.recipe_file import read_recipe

LABELS = ("forward_flow", "boxes", "depth", "segmentation")
NOT_READ = ("rectify_map.h5", "cam_to_cam.yaml", "zarr.json")
"""Files, by the ends of their names, that a reader has no use of, or that only group others."""


def everything(layout: str, folder: Path) -> dict[str, np.ndarray]:
    """All arrays that the reader gives, by name."""
    reader = reader_of(layout)(folder)
    found = {f"events.{n}": a for n, a in zip("txyp", reader.events(0, 10**12))}
    found["count"] = np.array(reader.count)
    for kind in reader.kinds("cam0"):
        found |= {f"{kind}.{n}": np.asarray(a) for n, a in reader.labels(kind, 0, 10**12).items()}
    return found


@pytest.mark.parametrize("layout", EVERY)
@pytest.mark.parametrize("damage", ["cut", "cut by 1000", "missing", "overwritten"])
def test_a_damaged_file_is_named(layout: str, damage: str, tmp_path: Path) -> None:
    """For each file in turn: one line, or what was written; never anything else."""
    about, plain = simulated("spinning_disk", *LABELS)
    folder = tmp_path / "s"
    written(layout, folder, about, framed(plain))
    want = everything(layout, folder)
    unread = (*NOT_READ, *([".png"] if layout == "coco" else []))
    files = sorted(path for path in folder.rglob("*") if path.is_file() and not path.name.endswith(unread))
    refused = 0
    for path in files:
        whole = path.read_bytes()
        if damage == "missing":
            path.unlink()
        elif damage == "overwritten":
            path.write_bytes(b"\x07" * len(whole))
        else:
            path.write_bytes(whole[: len(whole) // 2] if damage == "cut" else whole[: max(len(whole) - 1000, 0)])
        try:
            got = everything(layout, folder)
        except LayoutError as error:
            refused += 1
            text = str(error)
            assert str(folder) in text and "\n" not in text and len(text) < 600, text
            assert "fetch its files again" in text or "about.json" in text, text
        else:
            lost = {name.partition(".")[0] for name in want.keys() - got.keys()}
            if damage == "missing" and lost:  # a kind whose files are gone is not listed; asked for, it is refused
                with pytest.raises(LayoutError, match="has no labels"):
                    reader_of(layout)(folder).labels(min(lost), 0, 1)
                refused += 1
            for name, array in got.items():
                assert array.tobytes() == want[name].tobytes(), (path, name)
        path.write_bytes(whole)
    assert refused >= 0.5 * len(files) > 0
    assert all(np.array_equal(a, want[n], equal_nan=True) for n, a in everything(layout, folder).items())


@pytest.mark.parametrize("layout", EVERY)
def test_another_layout_is_named(layout: str, tmp_path: Path) -> None:
    """By the sequence's own word; and a folder without it is no sequence."""
    about, steps = simulated("spinning_disk", *LABELS)
    other = "npz" if layout == "dsec" else "dsec"
    written(other, tmp_path / "s", about, steps)
    with pytest.raises(LayoutError, match=rf"s has the layout {other}, not {layout}: reader_of\('{other}'\) reads it"):
        reader_of(layout)(tmp_path / "s")
    with pytest.raises(LayoutError, match=r"is no sequence that evis wrote: it has no about\.json"):
        reader_of(layout)(tmp_path)


def test_blosc_without_its_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The remedy is the extra that has it."""
    about, steps = simulated("spinning_disk", *LABELS)
    written("dsec", tmp_path / "s", about, steps)
    monkeypatch.setitem(sys.modules, "hdf5plugin", None)
    with pytest.raises(
        LayoutError, match=r"events\.h5 is packed with Blosc, which needs hdf5plugin: pip install 'evis"
    ):
        reader_of("dsec")(tmp_path / "s").events(0, 1_000_000)


def test_zarr_without_its_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Writing, making a data set, and reading."""
    about, steps = simulated("spinning_disk", *LABELS)
    monkeypatch.setitem(sys.modules, "zarr", None)
    line = r"the layout zarr needs the package zarr: pip install 'evis\[layouts\]'"
    with pytest.raises(LayoutError, match=line):
        written("zarr", tmp_path / "s", about, steps)
    assert not (tmp_path / "s").exists()
    with pytest.raises(LayoutError, match=line):  # before a worker starts or a folder is made
        make(read_recipe(write(tmp_path, ("layout: npz", "layout: zarr"))), str(tmp_path / "d"), InThisProcess)
    assert not (tmp_path / "d").exists()
    folder: Any = tmp_path / "t"
    written("npz", folder, about, steps)
    text = (folder / "about.json").read_text()
    (folder / "about.json").write_text(text.replace('"layout": "npz"', '"layout": "zarr"'))
    with pytest.raises(LayoutError, match=line):
        reader_of("zarr")(folder).events(0, 1)
