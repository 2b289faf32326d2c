"""What is left of a recording after any kind of end."""

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from bag_messages import copied, same, scene
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from evis.bag import BagError
from evis.bag.mcap import container
from evis.bag.reader import BagReader
from evis.bag.recover import recover
from evis.bag.writer import BagWriter

HERE = Path(__file__).parents[1]


def write(path, keyframes=12, chunk_bytes=3000, envs=1):
    with BagWriter(path, {"evis": {"seed": "1"}}, chunk_bytes=chunk_bytes) as writer:
        for k in range(keyframes):
            for topic, message in scene(k, envs).items():
                if topic != "/diagnostics":
                    writer.write(topic, message)
    return path


def read(path):
    with BagReader(path) as reader:
        return [(t, copied(m)) for t, m in reader.messages()], reader.problem


def chunk_ends(path):
    """(end of each chunk record, messages of ours in it), by the MCAP library."""
    with open(path, "rb") as file:
        summary = make_reader(file).get_summary()
    closing = {c.id for c in summary.channels.values() if c.metadata["evis.part"] == "meta"}
    result = []
    for index in summary.chunk_indexes:
        with open(path, "rb") as file:
            file.seek(index.chunk_start_offset)
            from mcap.stream_reader import breakup_chunk

            chunk = next(StreamReader(file, skip_magic=True, emit_chunks=True).records)
        count = sum(1 for r in breakup_chunk(chunk) if getattr(r, "channel_id", 0) in closing and hasattr(r, "data"))
        result.append((index.chunk_start_offset + index.chunk_length, count))
    return result


CHILD = """
import os, signal, sys
sys.path.insert(0, {here!r})
from bag_messages import scene
from evis.bag.writer import BagWriter
writer = BagWriter(sys.argv[1], chunk_bytes=20_000, chunk_period_s={period})
for k in range(40):
    for topic, message in scene(k).items():
        writer.write(topic, message)
{end}
"""


def child(path, period, end):
    code = CHILD.format(here=str(HERE), period=period, end=end)
    return subprocess.Popen([sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE)


def test_kill_9_loses_at_most_one_chunk(tmp_path):
    """A process kills itself while it writes; all but the open chunk is there, in order and bit by bit."""
    process = child(tmp_path / "a.mcap", 1e6, "os.kill(os.getpid(), signal.SIGKILL)")
    process.communicate(timeout=600)
    assert process.returncode == -signal.SIGKILL
    with BagWriter(tmp_path / "whole.mcap", chunk_bytes=20_000, chunk_period_s=1e6) as writer:
        for k in range(40):
            for topic, message in scene(k).items():
                writer.write(topic, message)
    messages, problem = read(tmp_path / "a.mcap")
    counts = [count for _, count in chunk_ends(tmp_path / "whole.mcap")]
    assert "end" in problem and len(counts) > 5
    assert len(messages) in (sum(counts), sum(counts[:-1]))
    states = [m for t, m in messages if t == "/state"]
    assert [m.header.seq for m in states] == list(range(len(states)))
    assert all(same(m, scene(m.header.seq)["/state"]) for m in states)


def test_kill_9_after_a_pause_loses_nothing(tmp_path):
    """The open chunk comes to the file in time, without any further message."""
    process = child(tmp_path / "a.mcap", 0.1, "print('written', flush=True)\nimport time; time.sleep(600)")
    try:
        assert process.stdout.readline() == b"written\n"
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and len(read(tmp_path / "a.mcap")[0]) < 40 * len(scene(0)):
            time.sleep(0.05)
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
    messages, _ = read(tmp_path / "a.mcap")
    assert len(messages) == 40 * len(scene(0))


def test_a_pause_does_not_hold_back_messages(tmp_path):
    """One message and then silence: after 100 ms it is in the file."""
    writer = BagWriter(tmp_path / "a.mcap")
    writer.write("/state", scene(0)["/state"])
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and not read(tmp_path / "a.mcap")[0]:
        time.sleep(0.02)
    messages, _ = read(tmp_path / "a.mcap")
    writer.close()
    assert [t for t, _ in messages] == ["/state"]


def test_truncated_at_every_1000th_byte(tmp_path):
    """Every complete chunk is read and nothing else, never with a crash, and `recover` saves the same."""
    whole = write(tmp_path / "a.mcap")
    data = whole.read_bytes()
    reference, problem = read(whole)
    assert problem == ""
    ends = chunk_ends(whole)
    assert len(ends) > 20
    torn = tmp_path / "torn.mcap"
    for size in [*range(1000, len(data), 1000), len(data) - 1]:
        torn.write_bytes(data[:size])
        messages, problem = read(torn)
        assert problem
        assert len(messages) == sum(count for end, count in ends if end <= size)
        assert all(any(same(m, other) for t2, other in reference if t == t2) for t, m in messages[-3:])
        if size % 5000 == 0:
            result = recover(torn, tmp_path / "saved.mcap")
            saved, problem = read(tmp_path / "saved.mcap")
            assert problem == "" and result.damaged == 0 and len(saved) == len(messages)
            assert all(a[0] == b[0] and same(a[1], b[1]) for a, b in zip(saved, messages))
            with open(tmp_path / "saved.mcap", "rb") as file:
                assert sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages()) == result.messages


def test_environments_torn_apart(tmp_path):
    """A message is given only when all of its environments are there."""
    data = write(tmp_path / "a.mcap", envs=3, chunk_bytes=800).read_bytes()
    torn = tmp_path / "torn.mcap"
    for size in range(2000, len(data), 9001):
        torn.write_bytes(data[:size])
        for topic, message in read(torn)[0]:
            assert same(message, scene(message.header.seq, 3)[topic])


def test_damaged_bytes_anywhere(tmp_path):
    """A flipped byte costs at most its chunk; what is read is right, and the damage is told."""
    whole = write(tmp_path / "a.mcap", keyframes=6)
    data = bytearray(whole.read_bytes())
    reference = read(whole)[0]
    rng = np.random.default_rng(0)
    torn = tmp_path / "torn.mcap"
    noticed = 0
    for at in rng.integers(8, len(data), 150):
        damaged = bytearray(data)
        damaged[at] ^= 1 << int(rng.integers(0, 8))
        torn.write_bytes(damaged)
        try:
            with BagReader(torn) as reader:
                messages = [(t, copied(m)) for t, m in reader.messages()]
                noticed += bool(reader.problem or reader.skipped)
        except BagError as error:
            assert str(torn) in str(error) or "topic" in str(error)
            continue
        for topic, message in messages[:5]:
            assert any(topic == t and same(message, m) for t, m in reference)
    assert noticed > 20


@pytest.mark.parametrize("content", [b"", b"x", b"\x89MCAP0\r\n", b"PK\x03\x04" * 100, bytes(5000)])
def test_files_that_are_no_bags(tmp_path, content):
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    try:
        with BagReader(path) as reader:
            assert content.startswith(b"\x89MCAP") and reader.problem and not list(reader.messages())
    except BagError as error:
        assert str(path) in str(error) and "\n" not in str(error)


def test_missing_bag(tmp_path):
    with pytest.raises(BagError, match=r"cannot read .*nothing\.mcap: No such file"):
        BagReader(tmp_path / "nothing.mcap")


def test_claimed_sizes_are_not_believed(tmp_path):
    """A chunk that claims an exabyte, a record that claims more than the file."""
    import struct

    chunk = struct.pack("<QQQII", 0, 0, 1 << 60, 0, 4) + b"zstd" + struct.pack("<Q", 5) + b"12345"
    for body in (struct.pack("<BQ", 6, len(chunk)) + chunk, struct.pack("<BQ", 6, 1 << 62) + chunk):
        (tmp_path / "a.mcap").write_bytes(container.MAGIC + body)
        messages, problem = read(tmp_path / "a.mcap")
        assert messages == [] and problem


def fill_disk(monkeypatch, after):
    """From now on the disk takes `after` more bytes, with a short write at the border as on a real one."""
    left = [after]
    real = os.writev

    def writev(descriptor, views):
        if left[0] <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        room, cut = left[0], []
        for view in views:
            cut.append(view[:room])
            room -= len(cut[-1])
            if room <= 0:
                break
        written = real(descriptor, cut)
        left[0] -= written
        return written

    monkeypatch.setattr(container.os, "writev", writev)
    return left


@pytest.mark.parametrize("room", [500, 9000, 20_000])
def test_full_disk(tmp_path, monkeypatch, room):
    """One clear error, and the bag until then opens whole; closing raises nothing more."""
    path = tmp_path / "a.mcap"
    writer = BagWriter(path, chunk_bytes=3000)
    left = fill_disk(monkeypatch, room)
    sent = 0
    with pytest.raises(BagError, match=r"a\.mcap: No space left on device after .* MB; recording has stopped"):
        for k in range(1000):
            writer.write("/state", scene(k)["/state"])
            sent += 1
    with pytest.raises(BagError, match="No space left"):
        writer.write("/state", scene(0)["/state"])
    left[0] = 1 << 20  # what was cut off has given a little room back
    writer.close()
    messages, problem = read(path)
    assert problem == ""
    assert sent - 10 <= len(messages) <= sent and all(same(m, scene(i)["/state"]) for i, (_, m) in enumerate(messages))


def test_full_disk_without_room_for_the_index(tmp_path, monkeypatch):
    writer = BagWriter(tmp_path / "a.mcap", chunk_bytes=3000)
    fill_disk(monkeypatch, 9000)
    with pytest.raises(BagError):
        for k in range(1000):
            writer.write("/state", scene(k)["/state"])
    writer.close()
    messages, problem = read(tmp_path / "a.mcap")
    assert messages and problem


def test_device_that_is_always_full():
    if not os.path.exists("/dev/full"):
        pytest.skip("no /dev/full on this system")
    with pytest.raises(BagError, match="/dev/full: No space left"):
        BagWriter("/dev/full")


def test_an_older_bag_is_kept(tmp_path):
    path = tmp_path / "a.mcap"
    write(path, keyframes=2)
    old = path.read_bytes()
    with BagWriter(path) as writer:
        assert writer.backup == tmp_path / "a.mcap.bak" and writer.backup.read_bytes() == old
    assert read(path) == ([], "")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.mcap", "a.mcap.bak"]


def test_no_older_bag_is_ever_lost(tmp_path):
    """One by one; but bags without a message, as runs leave that fail at their start, are not kept."""
    path = tmp_path / "a.mcap"
    contents = []
    for keyframes in (2, 3, 4):
        write(path, keyframes=keyframes)
        contents.append(path.read_bytes())
    for _ in range(2):
        BagWriter(path).close()
    path.write_bytes(b"")
    write(path, keyframes=1)
    torn = path.read_bytes()[:-50]
    path.write_bytes(torn)
    BagWriter(path).close()
    kept = ["a.mcap.bak", "a.mcap.bak2", "a.mcap.bak3", "a.mcap.bak4"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.mcap", *kept]
    assert [(tmp_path / name).read_bytes() for name in kept] == [*contents, torn]


def test_a_bag_that_is_being_recorded_is_left_alone(tmp_path):
    """A second writer of the same name, here or in another process, is refused; nothing of either is lost."""
    path = tmp_path / "a.mcap"
    with BagWriter(path):
        before = path.read_bytes()
        with pytest.raises(BagError, match="another run is recording to it"):
            BagWriter(path)
        other = "import sys; from evis.bag.writer import BagWriter; BagWriter(sys.argv[1])"
        done = subprocess.run([sys.executable, "-c", other, str(path)], capture_output=True, text=True)
        assert done.returncode and "another run is recording to it" in done.stderr
        assert path.read_bytes() == before and [p.name for p in tmp_path.iterdir()] == ["a.mcap"]
    BagWriter(path).close()


def test_paths_that_cannot_be_written(tmp_path):
    with pytest.raises(BagError, match=r"there is no directory .*/missing"):
        BagWriter(tmp_path / "missing" / "a.mcap")
    with pytest.raises(BagError, match="is a folder"):
        BagWriter(tmp_path)
    if os.geteuid() == 0:
        return
    tmp_path.chmod(0o500)
    with pytest.raises(BagError, match="Permission denied"):
        BagWriter(tmp_path / "a.mcap")


def test_recover_leaves_the_source_alone(tmp_path):
    path = write(tmp_path / "a.mcap", keyframes=3)
    data = path.read_bytes()
    path.write_bytes(data[:-40])
    result = recover(path)
    assert result.path == tmp_path / "a.recovered.mcap" and result.problem and path.read_bytes() == data[:-40]
    with BagReader(result.path) as reader:
        assert reader.metadata["evis"] == {"seed": "1"}
    with pytest.raises(BagError, match="into itself"):
        recover(path, path)


@pytest.mark.parametrize("later", [True, False])
def test_a_bag_that_is_deleted_meanwhile_is_told(later, tmp_path):
    path = tmp_path / "folder" / "a.mcap"
    path.parent.mkdir()
    writer = BagWriter(path)
    for topic, message in scene(0).items():
        writer.write(topic, message)
    writer.flush()
    path.unlink()
    path.parent.rmdir()
    with pytest.raises(BagError, match=r"a\.mcap: it was deleted while it was recorded, and is lost"):
        if later:
            for topic, message in scene(1).items():
                writer.write(topic, message)
            writer.flush()
        writer.close()
    writer.close()


def test_a_bag_that_is_renamed_meanwhile_is_whole(tmp_path):
    with BagWriter(tmp_path / "a.mcap") as writer:
        for topic, message in scene(0).items():
            writer.write(topic, message)
        (tmp_path / "a.mcap").rename(tmp_path / "b.mcap")
    assert read(tmp_path / "b.mcap")[1] == "" and len(read(tmp_path / "b.mcap")[0]) == len(scene(0))
