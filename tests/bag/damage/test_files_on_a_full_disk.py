"""A disk that takes no more leaves no part of a file, what was finished before, and one line that says so."""

import errno
import importlib.util
import os
import resource
import shutil
import subprocess
import sys

import numpy as np
import pytest

from evis.bag import BagError
from evis.bag.mcap import container
from evis.bag.writer import BagWriter
from evis.files.whole_file import whole_file
from msgs.camera import Keyframe
from msgs.header import Header

LIMIT = 20_000
"""Bytes that a file may have; the system refuses the rest, as a full disk does."""


def limited(*words):
    """`evis` with that limit: exit status and standard error."""
    done = subprocess.run(
        [sys.executable, "-m", "evis", *map(str, words)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        timeout=600,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (LIMIT, LIMIT)),
    )
    return done.returncode, done.stderr


@pytest.fixture(scope="module")
def noise(tmp_path_factory):
    """A recording whose pictures no format makes small."""
    rng = np.random.default_rng(0)
    n = 60_000
    t = np.sort(rng.integers(0, 200_000_000, n))
    x, y = rng.integers(0, 200, n).astype(np.uint16), rng.integers(0, 150, n).astype(np.uint16)
    path = tmp_path_factory.mktemp("noise") / "noise.npz"
    np.savez(path, t=t, x=x, y=y, p=rng.integers(0, 2, n).astype(np.uint8))
    return path


@pytest.mark.parametrize("ending", [".gif", ".png", ".mp4"])
@pytest.mark.parametrize("older", [True, False])
def test_a_drawing_is_whole_or_as_it_was(tmp_path, noise, ending, older):
    if ending == ".mp4" and not (shutil.which("ffmpeg") or importlib.util.find_spec("av")):
        pytest.skip("neither ffmpeg nor PyAV is here")
    out = tmp_path / f"drawn{ending}"
    if older:
        out.write_bytes(b"older")
    status, error = limited("events", "render", noise, out)
    assert status == 1 and len(error.splitlines()) == 1
    assert f"{out}: " in error and "File too large" in error and ".part" not in error
    assert [path.name for path in tmp_path.iterdir()] == ([out.name] if older else [])
    assert not older or out.read_bytes() == b"older"


def test_exr_files_before_the_full_disk_are_whole(tmp_path):
    """Two keyframes that compress well and one that does not."""
    import OpenEXR

    rng = np.random.default_rng(0)
    grey = np.full((1, 80, 100, 3), 0.5, np.float32)
    with BagWriter(tmp_path / "a.mcap") as writer:
        for k, radiance in enumerate([grey, 2 * grey, rng.normal(size=grey.shape).astype(np.float32), grey]):
            writer.write(
                "/cam0/keyframe", Keyframe(Header(k * 10**7, k), radiance=radiance, episodes=np.zeros(1, np.int32))
            )
    status, error = limited("bag", "export", tmp_path / "a.mcap", "--topic", "/cam0/keyframe", tmp_path / "exr")
    assert status == 1 and len(error.splitlines()) == 1
    assert f"{tmp_path}/exr/000002.exr: " in error and "the 2 keyframes before it are whole" in error
    assert sorted(path.name for path in (tmp_path / "exr").iterdir()) == ["000000.exr", "000001.exr"]
    for k, value in enumerate((0.5, 1.0)):
        with OpenEXR.File(str(tmp_path / "exr" / f"{k:06d}.exr")) as file:
            assert (file.channels()["RGB"].pixels == value).all()


def test_what_is_no_file_is_written_in_place(tmp_path):
    with whole_file("/dev/null") as place:
        place.write_bytes(b"gone")
    assert os.path.exists("/dev/null") and not os.path.isfile("/dev/null")
    with pytest.raises(OSError, match="is a folder; name a file"), whole_file(tmp_path):
        pytest.fail("a folder was given out")


def test_a_link_stays_one(tmp_path):
    (tmp_path / "real.txt").write_text("older")
    (tmp_path / "link.txt").symlink_to("real.txt")
    with pytest.raises(RuntimeError), whole_file(tmp_path / "link.txt") as place:
        place.write_text("half")
        raise RuntimeError
    assert (tmp_path / "real.txt").read_text() == "older"
    with whole_file(tmp_path / "link.txt") as place:
        place.write_text("new")
    assert (tmp_path / "link.txt").is_symlink() and (tmp_path / "real.txt").read_text() == "new"
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("older", [True, False])
def test_a_bag_that_has_no_room_is_not_recovered_in_part(tmp_path, older):
    """What it would lack is still in its source; an older file of its name is as it was."""
    values = np.random.default_rng(0).normal(size=(1, 80, 100, 3)).astype(np.float32)
    with BagWriter(tmp_path / "a.mcap") as writer:
        writer.write("/cam0/keyframe", Keyframe(Header(0, 0), radiance=values, episodes=np.zeros(1, np.int32)))
    out = tmp_path / "out.mcap"
    if older:
        out.write_bytes(b"older")
    status, error = limited("bag", "recover", tmp_path / "a.mcap", out)
    assert status == 1 and len(error.splitlines()) == 1
    assert f"{out}: File too large; nothing is left of it" in error and "recording" not in error
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mcap", *(["out.mcap"] if older else [])]
    assert not older or out.read_bytes() == b"older"


def test_a_disk_without_room_for_the_first_bytes_keeps_what_was_there(tmp_path, monkeypatch):
    """The name is taken only by a file in which something is."""

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    (tmp_path / "a.mcap").write_bytes(b"older")
    monkeypatch.setattr(container.os, "writev", full)
    for name, content in (("a.mcap", b"older"), ("b.mcap", None)):
        with pytest.raises(BagError, match=f"{name}: No space left on device; nothing could be written"):
            BagWriter(tmp_path / name)
        assert content is None or (tmp_path / name).read_bytes() == content
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]
