"""Sequences that somebody has made to do harm: refused in one line, in a child whose memory and time are limited."""

from __future__ import annotations

import io
import json
import os
import shutil
import tarfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import pytest
from limited import output_of, refused_by
from numpy.lib import format as npy
from sequences import EVERY, simulated, written

from evis.dataset.layouts import LayoutError, reader_of
from evis.dataset.making.store import RemoteStore

READ = (
    "import sys; from evis.dataset.layouts import reader_of; from pathlib import Path; "
    "reader = reader_of(sys.argv[1])(Path(sys.argv[2])); str(reader.events(0, 10**12).x[:2]); "
    "[reader.labels(kind, 0, 10**12) for kind in reader.kinds('cam0')]"
)


def sequence(layout: str, folder: Path, *labels: str) -> Path:
    """A whole sequence, of which the tests change something."""
    about, steps = simulated("spinning_disk", *(labels or ("boxes", "segmentation")))
    written(layout, folder, about, steps)
    return folder


def refused(layout: str, folder: Path) -> str:
    told = refused_by(READ, layout, folder)
    assert "\n" not in told and len(told) < 600, told
    return told


def rewritten(path: Path, name: str, change: Callable[[bytes], bytes], packing: int = zipfile.ZIP_STORED) -> None:
    """Changes a member of an archive."""
    with zipfile.ZipFile(path) as archive:
        members = {member: archive.read(member) for member in archive.namelist()}
    members[name] = change(members[name])
    with zipfile.ZipFile(path, "w", packing) as archive:
        for member, content in members.items():
            archive.writestr(member, content)


def array(descr: Any, shape: tuple[int, ...], content: bytes) -> bytes:
    file = io.BytesIO()
    npy.write_array_header_1_0(file, {"descr": descr, "fortran_order": False, "shape": shape})
    return file.getvalue() + content


@pytest.mark.parametrize("descr", ["|O", [("a", "|O")], "|V8"])
def test_python_objects_are_never_made_of_a_file(descr: Any, tmp_path: Path) -> None:
    """They would be addresses that the file chooses: the process died of it, or did what the file wants."""
    folder = sequence("npz", tmp_path / "s")
    count = reader_of("npz")(folder).count
    rewritten(folder / "cam0" / "events.npz", "x.npy", lambda _: array(descr, (count,), b"A" * 8 * count))
    assert "events.npz: x is an array of" in refused("npz", folder)


def test_an_archive_in_a_shard_takes_no_more_than_its_size_allows(tmp_path: Path) -> None:
    folder = sequence("webdataset", tmp_path / "s")
    shard, changed = folder / "000000.tar", tmp_path / "new.tar"
    bomb = io.BytesIO()
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("t.npy", "w") as entry:
        entry.write(array("<i8", (100 << 20,), b""))
        for _ in range(100):
            entry.write(bytes(8 << 20))
    with tarfile.open(shard) as old, tarfile.open(changed, "w", format=tarfile.USTAR_FORMAT) as new:
        for member in old:
            content = old.extractfile(member)
            assert content is not None
            data = bomb.getvalue() if member.name.endswith("events.npz") else content.read()
            member.size = len(data)
            new.addfile(member, io.BytesIO(data))
    changed.replace(shard)
    assert "over the limit of" in refused("webdataset", folder)


@pytest.mark.parametrize(
    "told", [b"[" * 100_000, b"[]", b'{"camera": "cam0"}', b'{"camera": "other", "events": 0, "stamp_ns": 0}', b"\xff"]
)
def test_what_a_sample_says_of_itself_is_checked(told: bytes, tmp_path: Path) -> None:
    folder = sequence("webdataset", tmp_path / "s")
    with tarfile.open(folder / "000000.tar", "w", format=tarfile.USTAR_FORMAT) as shard:
        member = tarfile.TarInfo("cam0/00000000.json")
        member.size = len(told)
        shard.addfile(member, io.BytesIO(told))
    with pytest.raises(LayoutError, match=r"00000000\.json cannot be read"):
        reader_of("webdataset")(folder).count_of("cam0")


@pytest.mark.parametrize("layout", ["dsec", "mvsec"])
@pytest.mark.parametrize("kind", ["link", "virtual", "stored"])
def test_hdf5_of_a_sequence_reads_no_other_file(layout: str, kind: str, tmp_path: Path) -> None:
    folder = sequence(layout, tmp_path / "s", "boxes")
    path, name = (
        (folder / "events/left/events.h5", "events/x")
        if layout == "dsec"
        else (folder / "a_data.hdf5", "davis/left/events")
    )
    secret = tmp_path / "secret.h5"
    shutil.copy(path, secret)
    with h5py.File(path, "r+") as file:
        shape, dtype = file[name].shape, file[name].dtype
        del file[name]
        if kind == "link":
            file[name] = h5py.ExternalLink(str(secret), name)
        elif kind == "virtual":
            made = h5py.VirtualLayout(shape, dtype)
            made[:] = h5py.VirtualSource(str(secret), name, shape)
            file.create_virtual_dataset(name, made)
        else:
            file.create_dataset(name, shape, dtype, external=[(str(secret), 0, h5py.h5f.UNLIMITED)])
    with pytest.raises(LayoutError, match="EVIS_OTHER_FILES=1"):
        reader_of(layout)(folder).events(0, 10**12)


def changed(path: Path, **values: Any) -> None:
    whole = json.loads(path.read_text())
    path.write_text(json.dumps(whole | values))


def test_runs_of_a_mask_fill_it_and_no_more(tmp_path: Path) -> None:
    folder = sequence("coco", tmp_path / "s")
    path = folder / "annotations" / "instances.json"
    whole = json.loads(path.read_text())
    whole["annotations"][0]["segmentation"]["counts"] = [0, 10**11]
    path.write_text(json.dumps(whole))
    assert "a mask is not of 64 x 48 pixels" in refused("coco", folder)


def test_about_json_is_checked(tmp_path: Path) -> None:
    """Names of other folders, sizes and times that nothing has; each was followed, or filled the memory."""
    folder = sequence("npz", tmp_path / "s")
    path = folder / "about.json"
    whole = path.read_text()
    camera = json.loads(whole)["cameras"][0]
    for values, told in (
        ({"name": "../../other"}, "'../../other' leads out of its folder"),
        ({"cameras": [camera | {"name": "../../other"}]}, "leads out of its folder"),
        ({"cameras": [camera | {"name": "/etc"}]}, "leads out of its folder"),
        ({"cameras": [camera | {"width": 10**9, "height": 10**9}]}, "has 1000000000 x 1000000000 pixels"),
        ({"duration_ns": -1}, "it lasts from 0 to -1 ns"),
        ({"duration_ns": 1 << 63}, "it lasts from 0 to"),
        ({"duration_ns": "long"}, "its duration_ns is 'long'"),
        ({"seed": None}, "its seed is None"),
    ):
        path.write_text(whole)
        changed(path, **values)
        with pytest.raises(LayoutError, match=r"about\.json cannot be read") as caught:
            reader_of("npz")(folder)
        assert told in str(caught.value)
    for text in ("[" * 100_000, "[]"):
        path.write_text(text)
        with pytest.raises(LayoutError, match=r"about\.json cannot be read"):
            reader_of("npz")(folder)


@pytest.mark.parametrize("layout", ["webdataset", "coco"])
def test_a_sequence_that_claims_to_last_for_ages_is_read_in_few_blocks(layout: str, tmp_path: Path) -> None:
    """The list of its blocks took all memory; its events and stamps are there."""
    folder = sequence(layout, tmp_path / "s")
    whole = reader_of(layout)(folder)
    want, stamps = whole.rows(3, 20), whole.stamps("boxes")
    for about in folder.rglob("about.json"):
        changed(about, duration_ns=(1 << 62) - 1)
    code = (
        "import sys; from evis.dataset.layouts import reader_of; from pathlib import Path; "
        "r = reader_of(sys.argv[1])(Path(sys.argv[2])); "
        "raise ValueError(f'{r.rows(3, 20).t.tolist()} {r.stamps(\"boxes\").tolist()}')"
    )
    assert refused_by(code, layout, folder) == f"{want.t.tolist()} {stamps.tolist()}"


def test_names_of_a_bucket_stay_in_the_copy(tmp_path: Path) -> None:
    """A bucket may have any names; `..` in one led out of the folder that the sequence is copied to."""

    class Bucket:
        def find(self, place: str) -> list[str]:
            return [f"{place}/about.json", f"{place}/../../../../{tmp_path}/written"]

        def get_file(self, name: str, here: str) -> None:
            Path(here).write_text(name)

    store = RemoteStore.__new__(RemoteStore)
    store._files, store._root, store._out = Bucket(), "bucket/d", "s3://bucket/d"
    with pytest.raises(ValueError, match=r"leads out of its folder; it is not fetched"), store.local("0"):
        pass
    assert not (tmp_path / "written").exists()


@pytest.mark.extras
def test_zarr_is_of_numbers_and_of_the_size_that_it_says(tmp_path: Path) -> None:
    """A chunk of 100 kB unpacked to 3 GB, and the package knows codecs that EVIS does not write."""
    pytest.importorskip("zarr", reason="zarr is not installed: make test-extras")
    import zstandard

    size = 3 << 30
    packer = zstandard.ZstdCompressor().compressobj(size=size)
    bomb = b"".join(packer.compress(bytes(1 << 24)) for _ in range(size >> 24)) + packer.flush()
    folder = sequence("zarr", tmp_path / "s")
    column = folder / "sequence.zarr" / "cam0" / "events" / "x"
    whole, chunk = (column / "zarr.json").read_text(), (column / "c" / "0").read_bytes()
    grid = {"name": "regular", "configuration": {"chunk_shape": [size // 2]}}
    for values, content, told in (
        ({"chunk_grid": grid}, bomb, "over the limit of"),
        ({}, bomb, "unpacks to more than the"),
        ({"data_type": "string"}, chunk, "is an array of string"),
        ({"codecs": [{"name": "bytes"}, {"name": "gzip"}]}, chunk, "is packed by gzip"),
        ({"codecs": 3}, chunk, "zarr.json cannot be read"),
    ):
        (column / "zarr.json").write_text(whole)
        changed(column / "zarr.json", **values)
        (column / "c" / "0").write_bytes(content)
        with pytest.raises(LayoutError, match=told):
            reader_of("zarr")(folder).events(0, 10**12)


@pytest.mark.parametrize("layout", EVERY)
def test_a_pipe_in_place_of_a_file_is_not_waited_for(layout: str, tmp_path: Path) -> None:
    """Nobody writes to it. Each file of a sequence in turn; what is not read is left alone."""
    whole = sequence(layout, tmp_path / "whole")
    names = sorted(path.relative_to(whole).as_posix() for path in whole.rglob("*") if path.is_file())
    folders = []
    for k, name in enumerate(names):
        folders.append(tmp_path / str(k))
        shutil.copytree(whole, folders[-1])
        (folders[-1] / name).unlink()
        os.mkfifo(folders[-1] / name)
    read = READ.replace("sys.argv[2]", "argument").replace("import sys; ", "").split("; ", 2)[2]
    lines = ["import sys", "from pathlib import Path", "from evis.dataset.layouts import reader_of"]
    lines += ["for argument in sys.argv[2:]:", "    try:", f"        {read}", "        print('left alone')"]
    lines += ["    except ValueError as error:", "        print(str(error).replace(chr(10), ' '))"]
    told = dict(zip(names, output_of("\n".join(lines), [layout, *folders]).splitlines(), strict=True))
    refusals = {name: line for name, line in told.items() if line != "left alone"}
    assert "about.json" in refusals and len(refusals) > 1
    known = ("it is a named pipe, and must be a file", "is not there", "is no file", "lacks a chunk")
    assert all(any(text in line for text in known) for line in refusals.values()), refusals
