"""HDF5 files that name other files to be read, and chunks that unpack to more than they have room for."""

from __future__ import annotations

import subprocess
import sys
import zlib

import h5py
import numpy as np
import pytest

from evis.events import RecordingError, open_recording

N = 64
SECRET = b"THE SECRET OF ANOTHER FILE".ljust(2 * N, b"!")


def columns(file, leave_out=()):
    """t, x, y, p of N events."""
    made = {"t": np.arange(N, dtype="<i8") * 1000, "x": np.arange(N, dtype="<u2"), "y": np.zeros(N, "<u2")}
    for name, values in (made | {"p": np.ones(N, "u1")}).items():
        if name not in leave_out:
            file[name] = values


def external_storage(folder, file):
    columns(file, "x")
    file.create_dataset("x", (N,), "<u2", external=[(str(folder / "secret"), 0, 2 * N)])


def external_link(folder, file):
    columns(file, "x")
    file["x"] = h5py.ExternalLink(str(folder / "other.h5"), "/x")


def link_to_a_link(folder, file):
    columns(file, "x")
    file["away"] = h5py.ExternalLink(str(folder / "other.h5"), "/")
    file["x"] = h5py.SoftLink("/away/x")


def virtual_dataset(folder, file):
    columns(file, "x")
    layout = h5py.VirtualLayout((N,), "<u2")
    layout[:] = h5py.VirtualSource(str(folder / "other.h5"), "x", (N,))
    file.create_virtual_dataset("x", layout)


def offset_elsewhere(folder, file):
    columns(file)
    file.create_dataset("t_offset", (1,), "<i8", external=[(str(folder / "secret"), 0, 8)])


def size_elsewhere(folder, file):
    columns(file)
    file["height"] = np.array(480)
    file["width"] = h5py.ExternalLink(str(folder / "other.h5"), "/width")


def triggers_elsewhere(folder, file):
    rows = np.zeros(N, [("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
    file.create_group("CD")["events"] = rows
    file["EXT_TRIGGER"] = h5py.ExternalLink(str(folder / "other.h5"), "/")


def group_elsewhere(folder, file):
    file["CD"] = h5py.ExternalLink(str(folder / "other.h5"), "/")


CASES = [external_storage, external_link, link_to_a_link, virtual_dataset, offset_elsewhere, size_elsewhere,
         group_elsewhere]  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    """A file with a secret in it, plainly and as HDF5."""
    (tmp_path / "secret").write_bytes(SECRET)
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["x"] = np.frombuffer(SECRET, "<u2")
        other["width"] = np.array(640)
        other["events"] = np.zeros(N, [("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8"), ("id", "u1")])
    return tmp_path


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_other_files_are_refused(case, folder, monkeypatch):
    """In one line that names the way to allow them; then they are read."""
    with h5py.File(folder / "a.h5", "w") as file:
        case(folder, file)
    monkeypatch.delenv("EVIS_OTHER_FILES", raising=False)
    with pytest.raises(RecordingError, match=r"a\.h5: .*EVIS_OTHER_FILES=1") as refused:
        with open_recording(folder / "a.h5") as recording:
            recording.read()
    assert "\n" not in str(refused.value)
    monkeypatch.setenv("EVIS_OTHER_FILES", "1")
    with open_recording(folder / "a.h5") as recording:
        events = recording.read()
    if "secret" in str(refused.value) or "/x " in str(refused.value):
        assert len(events) == N
    if case is external_storage:
        np.testing.assert_array_equal(events.x, np.frombuffer(SECRET, "<u2"))


def test_triggers_of_another_file_are_left_out(folder, monkeypatch):
    """The events are read, and a warning says what was not."""
    monkeypatch.delenv("EVIS_OTHER_FILES", raising=False)
    with h5py.File(folder / "a.h5", "w") as file:
        triggers_elsewhere(folder, file)
    with open_recording(folder / "a.h5", size=(640, 480)) as recording:
        events = recording.read()
    assert len(events) == N and not len(events.triggers)
    assert "EVIS_OTHER_FILES=1" in " ".join(recording.info.warnings)


def test_links_within_the_file_are_followed(tmp_path, monkeypatch):
    """Soft links, and a chain of them, to datasets and groups of the same file."""
    monkeypatch.delenv("EVIS_OTHER_FILES", raising=False)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        columns(file.create_group("data"))
        for name in "typ":
            file[name] = h5py.SoftLink(f"data/{name}")
        file["one"] = h5py.SoftLink("/data")
        file["x"] = h5py.SoftLink("one/x")
        file["around"] = h5py.SoftLink("/around")
    with open_recording(tmp_path / "a.h5", topic="/") as recording:
        np.testing.assert_array_equal(recording.read().x, np.arange(N))


def test_a_loop_of_links_ends(tmp_path):
    """There are no events behind it."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        columns(file, "x")
        file["x"] = h5py.SoftLink("/y2")
        file["y2"] = h5py.SoftLink("/x")
    with pytest.raises(RecordingError, match="without events"):
        open_recording(tmp_path / "a.h5")


def test_a_chunk_that_unpacks_to_more_than_its_room(tmp_path):
    """The library would unpack all 300 MB: a process with 1.5 GiB refuses it in one line and uses little of that."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        columns(file, "x")
        file.create_dataset("x", (1 << 20,), "<u2", chunks=(1 << 20,), compression="gzip")
        packer = zlib.compressobj(1)
        bomb = b"".join([packer.compress(bytes(1 << 20)) for _ in range(300)]) + packer.flush()
        file["x"].id.write_direct_chunk((0,), bomb)
    code = (
        "import resource, sys\n"
        "resource.setrlimit(resource.RLIMIT_AS, (1536 << 20, 1536 << 20))\n"
        "from evis.events import RecordingError, open_recording\n"
        "try:\n"
        "    open_recording(sys.argv[1]).read()\n"
        "except RecordingError as error:\n"
        "    print(error)\n"
        "print(int(open('/proc/self/status').read().split('VmHWM:')[1].split()[0]) >> 10)\n"
    )
    run = [sys.executable, "-c", code, str(tmp_path / "a.h5")]
    done = subprocess.run(run, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    said, peak = done.stdout.splitlines()
    assert "a.h5: damaged: a chunk of /x" in said and int(peak) < 250, done.stdout
