"""Small files that would unpack, or make a reader ask for, gigabytes: each in a process with limits of memory.

The readers may use 1.5 GiB of address space (RLIMIT_AS), which the interpreter and its libraries share, and
little memory of it.
"""

from __future__ import annotations

import gzip
import io
import os
import signal
import sqlite3
import struct
import subprocess
import sys
import time
import zipfile
import zlib

import numpy as np
import pytest
from file_cases import save

from evis.events import RecordingError, open_recording

MB = 1 << 20
AS_MB, RSS_MB = 1536, 500
CODE = f"""
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, ({AS_MB} << 20, {AS_MB} << 20))
from evis.events import RecordingError, open_recording
try:
    with open_recording(sys.argv[1], "numpy") as recording:
        print("events", sum(len(block) for block in recording.blocks()))
except RecordingError as error:
    print(error)
print(int(open("/proc/self/status").read().split("VmHWM:")[1].split()[0]) >> 10)
"""


def refused(path, limit="") -> str:
    """What a reader with limited memory says of a file; its peak is checked. limit: EVIS_UNPACK_LIMIT."""
    environment = os.environ | {"EVIS_UNPACK_LIMIT": limit}
    run = [sys.executable, "-c", CODE, str(path)]
    done = subprocess.run(run, capture_output=True, text=True, timeout=120, env=environment)
    assert done.returncode == 0, done.stderr
    said, peak = done.stdout.splitlines()
    assert int(peak) < RSS_MB, done.stdout
    return said


def zeros(mb: int, wbits: int = zlib.MAX_WBITS) -> bytes:
    """So many MB of zeros, packed."""
    packer = zlib.compressobj(1, zlib.DEFLATED, wbits)
    return b"".join([packer.compress(bytes(MB)) for _ in range(mb)]) + packer.flush()


def mcap(compression: str, full: int, stored: bytes) -> bytes:
    """An MCAP of one chunk of another recorder, without an index."""
    from mcap.opcode import Opcode

    name = compression.encode()
    chunk = struct.pack("<QQQII", 0, 1, full, 0, len(name)) + name + struct.pack("<Q", len(stored)) + stored
    header = struct.pack("<I", 4) + b"ros2" + struct.pack("<I", 5) + b"other"
    parts = [(Opcode.HEADER, header), (Opcode.CHUNK, chunk), (Opcode.DATA_END, bytes(4)), (Opcode.FOOTER, bytes(20))]
    magic = b"\x89MCAP0\r\n"
    return magic + b"".join(struct.pack("<BQ", code, len(body)) + body for code, body in parts) + magic


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_chunk_of_an_mcap(compression, tmp_path):
    """700 MB in a chunk, of zeros packed in kB: refused by events and bags alike, with what would allow it."""
    from evis.bag import BagError
    from evis.bag.info import describe

    if compression == "zstd":
        import zstandard

        packer, size = zstandard.ZstdCompressor(level=3).compressobj(size=700 * MB), 700 * MB
        stored = b"".join([packer.compress(bytes(50 * MB)) for _ in range(14)]) + packer.flush()
    else:
        import lz4.frame as lz4

        size = 300 * MB
        stored = lz4.compress(bytes(size))[: MB // 2]
    path = save(tmp_path / "a.mcap", mcap(compression, size, stored))
    said = refused(path)
    if compression == "zstd":
        assert "a.mcap: " in said and "EVIS_UNPACK_LIMIT=" in said
        with pytest.raises(BagError, match=r"a\.mcap.*EVIS_UNPACK_LIMIT"):
            describe(path)


@pytest.mark.parametrize("name", ["a.csv.gz", "a.zip", "a.npz"])
def test_a_file_packed_as_a_whole(name, tmp_path):
    """80 MB of zeros or of events, by a limit of 2 or 8 MB."""
    text = b"0.1 1 1 1\n" * 100
    if name == "a.csv.gz":
        packed = gzip.compress(text) + zeros(80, 16 + zlib.MAX_WBITS)
    else:
        member, out = "events.txt" if name == "a.zip" else "t.npy", io.BytesIO()
        with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            with archive.open(member, "w") as file:
                if name == "a.npz":
                    np.lib.format.write_array_header_1_0(
                        file, {"descr": "<i8", "fortran_order": False, "shape": (10 * MB,)}
                    )
                for _ in range(80):
                    file.write((text * 1049)[:MB] if name == "a.zip" else bytes(MB))
            for column in "xyp" if name == "a.npz" else "":
                with archive.open(column + ".npy", "w") as file:
                    shape = {"descr": "|u1", "fortran_order": False, "shape": (10 * MB,)}
                    np.lib.format.write_array_header_1_0(file, shape)
                    for _ in range(10):
                        file.write(bytes(MB))
        packed = out.getvalue()
    said = refused(save(tmp_path / name, packed), "2M" if name == "a.zip" else "8M")
    assert f"{name}: " in said and "EVIS_UNPACK_LIMIT=" in said, said


def test_layers_share_one_allowance(tmp_path):
    """A bomb in a bomb may unpack no more than the outer file's size allows."""
    inner = zeros(270, 16 + zlib.MAX_WBITS)
    said = refused(save(tmp_path / "a.txt.gz.gz", gzip.compress(inner)))
    assert "a.txt.gz.gz: " in said and "EVIS_UNPACK_LIMIT=" in said


def test_the_header_of_an_array(tmp_path):
    """One that says 4 GB is not read."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in "txyp":
            archive.writestr(name + ".npy", b"\x93NUMPY\x02\x00\xf0\xff\xff\xff" + b" " * 1000)
    assert "claims 4294967280 bytes" in refused(save(tmp_path / "a.npz", out.getvalue()))


def test_a_computed_column_of_a_db3(tmp_path):
    """SQLite can compute a gigabyte for each row of a file of some kB."""
    path = tmp_path / "a.db3"
    with sqlite3.connect(path) as base:
        base.execute("CREATE TABLE topics (id INTEGER, name TEXT, type TEXT, serialization_format TEXT)")
        base.execute("INSERT INTO topics VALUES (1, '/e', 'dvs_msgs/msg/EventArray', 'cdr')")
        base.execute(
            "CREATE TABLE messages (id INTEGER, topic_id INTEGER, data GENERATED ALWAYS AS (zeroblob(900000000)))"
        )
        base.execute("INSERT INTO messages (id, topic_id) VALUES (1, 1)")
    assert refused(path).startswith(("events 0", str(path)))


def test_what_is_unpacked_has_no_name(tmp_path):
    """A process that is killed while it unpacks leaves nothing in the temporary folder."""
    text = b"".join(b"%d 1 1 1\n" % i for i in range(1000, 100_000))
    path, folder = save(tmp_path / "a.txt.gz", gzip.compress(text * 4, 1)), tmp_path / "temporary"
    folder.mkdir()
    code = (
        "import sys, time; from evis.events import open_recording\n"
        "recording = open_recording(sys.argv[1]); print('open', flush=True); time.sleep(100)"
    )
    run = [sys.executable, "-c", code, str(path)]
    with subprocess.Popen(run, stdout=subprocess.PIPE, env=os.environ | {"TMPDIR": str(folder)}) as process:
        seen = set()
        while not process.stdout.peek(1):
            seen |= set(os.listdir(folder))
            time.sleep(0.005)
        process.send_signal(signal.SIGKILL)
    assert not seen and not os.listdir(folder)


def test_a_full_temporary_folder(tmp_path, monkeypatch):
    """It is not filled to its end; the error names it and the way out."""
    path = save(tmp_path / "a.txt.gz", gzip.compress(b"0.1 1 1 1\n" * 1000))
    full = os.statvfs(tmp_path)
    monkeypatch.setattr(os, "fstatvfs", lambda descriptor: os.statvfs_result((*full[:4], 100, *full[5:])))
    with pytest.raises(RecordingError, match=r"a\.txt\.gz: cannot be unpacked into .*TMPDIR"):
        open_recording(path)


@pytest.mark.parametrize("words", [["measure"], ["render", "OUT"], ["render", "OUT", "--style", "time-surface"]])
def test_a_sensor_of_any_size(words, tmp_path):
    """A header that states 65535 x 65535 pixels: one line with the size it would take, and the way out."""
    path = save(tmp_path / "a.txt", b"65535 65535\n" + b"".join(b"0.%03d 1 1 1\n" % i for i in range(100, 200)))
    run = [word.replace("OUT", str(tmp_path / "a.gif")) for word in words]
    code = f"import resource\nresource.setrlimit(resource.RLIMIT_AS, ({2 * AS_MB} << 20,) * 2)\n" + (
        "import sys; from evis.cli import main; sys.exit(main(['events', *sys.argv[1:]]))"
    )
    command = [sys.executable, "-c", code, run[0], str(path), *run[1:]]
    done = subprocess.run(command, capture_output=True, text=True, timeout=100)
    assert done.returncode == 1 and len(done.stderr.splitlines()) == 1, done.stderr
    assert f"{path}: a sensor of 65535x65535 pixels takes 275 GB" in done.stderr and "--size WxH" in done.stderr
