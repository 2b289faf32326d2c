"""Large files in little memory: a process that may grow by 120 MB reads and seeks in files far larger."""

from __future__ import annotations

import os
import struct
import subprocess
import sys

import h5py
import numpy as np
import pytest
from file_cases import aedat2_davis, dvs_array_ros1, save, small_events

from evis.events import Events, open_recording, open_writer

MB = 1 << 20
CODE = """
import resource, sys
from evis.events import open_recording
import lz4.frame, zstandard, h5py  # loaded before the limit
path, seek = sys.argv[1], int(sys.argv[2])
with open_recording(sys.argv[3]) as small:
    small.read()
pages = int(open("/proc/self/statm").read().split()[0])
limit = pages * resource.getpagesize() + (120 << 20)
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
with open_recording(path, size=(640, 480)) as recording:
    if seek >= 0:
        recording.seek(seek)
    print(sum(len(block) for block in recording.blocks()), recording.info.truncated)
"""


def read_small(path, small, seek=-1) -> tuple[int, bool]:
    """(events, truncated) as the limited process finds them. small: a file of the same format, to load the code."""
    run = [sys.executable, "-c", CODE, str(path), str(seek), str(small)]
    done = subprocess.run(run, capture_output=True, text=True, timeout=600, env=os.environ | {"OMP_NUM_THREADS": "1"})
    assert done.returncode == 0, done.stderr
    count, truncated = done.stdout.split()
    return int(count), truncated == "True"


def dat_head(tmp_path):
    with open_writer(tmp_path / "small.dat", 640, 480) as writer:
        writer.write(small_events(10))
    return (tmp_path / "small.dat").read_bytes()[:-80]


@pytest.mark.parametrize("name", ["dat", "aedat2", "aedat4", "bag", "hdf5"])
def test_whole_files(name, tmp_path):
    """200 to 400 MB each, most of it holes of the file system, or the same packet again and again."""
    events = small_events(16000, 640, 480)
    small = tmp_path / f"small.{name}"
    large = tmp_path / f"large.{name}"
    if name in ("dat", "aedat2"):
        head = dat_head(tmp_path) if name == "dat" else aedat2_davis(Events.empty())
        save(small, head + bytes(80))
        save(large, head)
        os.truncate(large, len(head) + 240 * MB - 1)
        with large.open("ab") as file:
            file.write(b"\x10")  # zeros to the end would be pages that were never written
        expected = 30 * MB
    elif name == "aedat4":
        with open_writer(tmp_path / "a.aedat4", 640, 480, "none") as writer:
            writer.write(events)
        data = (tmp_path / "a.aedat4").read_bytes()
        begin = 18 + struct.unpack_from("<I", data, 14)[0]
        end = begin + 8 + struct.unpack_from("<ii", data, begin)[1]
        at = data.index(struct.pack("<q", end), 0, begin)
        head = data[:at] + struct.pack("<q", -1) + data[at + 8 : begin]
        save(small, head + data[begin:end])
        with large.open("wb") as file:
            file.write(head)
            for _ in range(1200):
                file.write(data[begin:end])
        expected = 1200 * 16000
    elif name == "bag":
        rosbag1 = pytest.importorskip("rosbags.rosbag1")
        with rosbag1.Writer(small) as writer:
            connection = writer.add_connection("/e", "dvs_msgs/msg/EventArray", msgdef="uint8 a", md5sum="0" * 32)
            writer.write(connection, 10**9, dvs_array_ros1(events, 640, 480))
        data = small.read_bytes()
        start = 4096 + 13  # behind the padded bag header
        chunk = 4 + struct.unpack_from("<I", data, start)[0]
        size = chunk + 4 + struct.unpack_from("<I", data, start + chunk)[0]
        with large.open("wb") as file:
            file.write(data[:start])
            for _ in range(1000):
                file.write(data[start : start + size])
        expected = 1000 * 16000
    else:
        kind = np.dtype([("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
        for path, n in ((small, 10), (large, 25_000_000)):
            with h5py.File(path, "w") as file:
                file.attrs["geometry"] = "640x480"
                creation = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
                creation.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
                creation.set_fill_time(h5py.h5d.FILL_TIME_NEVER)  # a hole of the file system
                group, rows = file.create_group("CD"), h5py.h5s.create_simple((n,))
                h5py.h5d.create(group.id, b"events", h5py.h5t.py_create(kind, logical=True), rows, creation)
        expected = 25_000_000
    count, truncated = read_small(large, small)
    assert count == expected and not truncated


def test_the_end_of_100_gb(tmp_path):
    """A DAT file of 100 GB (a hole, and events at its end): opened, and sought in, at once."""
    head, tail = dat_head(tmp_path), small_events(5000, 640, 480, seed=4)
    path = save(tmp_path / "a.dat", head)
    try:
        os.truncate(path, len(head) + (100 << 30))
    except OSError as error:
        pytest.skip(f"the file system has no such large files: {error.strerror}")
    with path.open("ab") as file:
        words = tail.x.astype(np.uint32) | tail.y.astype(np.uint32) << 14 | tail.p.astype(np.uint32) << 28
        file.write(np.stack([(tail.t // 1000).astype(np.uint32), words], 1).tobytes())
    with open_recording(path) as recording:
        recording.seek(int(tail.t[1000]))
        rest = recording.read()
    np.testing.assert_array_equal(rest.t, tail.t[np.searchsorted(tail.t, tail.t[1000]) :])
    small = save(tmp_path / "b.dat", head + bytes(80))
    assert read_small(path, small, int(tail.t[1000])) == (len(rest), False)


@pytest.mark.parametrize("kind", ["lz4", "zstd", "bz2"])
def test_a_bomb_is_refused(kind, tmp_path):
    """A packet that unpacks to more than the limit is refused before it is unpacked."""
    from evis.events.files.reading.decompress import inflate
    from evis.files.allowance import Allowance, AllowanceError

    block = bytes(20 * MB)
    if kind == "lz4":
        import lz4.frame as lz4

        data = lz4.compress(block)
    elif kind == "zstd":
        import zstandard

        data = zstandard.compress(block)
    else:
        import bz2

        data = bz2.compress(block, 1)
    small = Allowance(len(data), ratio=10, base=MB)
    with pytest.raises(AllowanceError, match="over the limit"):
        inflate(kind, data, small)
    assert small.taken <= small.limit
    assert len(inflate(kind, data, Allowance(len(data)))) == len(block)
