"""Files of keys: private, never overwritten, in the form that ZeroMQ's own tools read."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest
import zmq
import zmq.auth

from evis.remote.keys import KeyFileError, make_pair, read_pair, read_public


def test_zmq_reads_what_was_made(tmp_path: Path) -> None:
    public, secret = make_pair(str(tmp_path / "lab"))
    assert [path.name for path in (public, secret)] == ["lab.key", "lab.key_secret"]
    assert [stat.S_IMODE(path.stat().st_mode) for path in (public, secret)] == [0o600, 0o600]
    assert zmq.auth.load_certificate(public) == (read_public(public), None)
    pair = read_pair(secret)
    assert zmq.auth.load_certificate(secret) == (pair.public, pair.secret) and pair.public == read_public(public)
    assert zmq.curve_public(pair.secret) == pair.public


def test_what_zmq_made_is_read(tmp_path: Path) -> None:
    public, secret = zmq.auth.create_certificates(tmp_path, "other", {"of": "a = b"})
    os.chmod(secret, 0o600)
    assert read_public(Path(public)) == read_pair(Path(secret)).public == zmq.auth.load_certificate(public)[0]


@pytest.mark.parametrize("ending", [".key", ".key_secret"])
def test_no_file_is_overwritten(tmp_path: Path, ending: str) -> None:
    """Nor does half a pair stay behind, nor is a link followed that leads nowhere yet."""
    for there in (lambda path: path.write_text("mine"), lambda path: path.symlink_to(tmp_path / "elsewhere")):
        path = tmp_path / f"lab{ending}"
        there(path)
        with pytest.raises(KeyFileError, match="never overwritten"):
            make_pair(str(tmp_path / "lab"))
        assert [left.name for left in tmp_path.iterdir()] == [path.name]
        path.unlink()


def test_a_secret_that_others_can_read_is_refused(tmp_path: Path) -> None:
    _, secret = make_pair(str(tmp_path / "lab"))
    for mode in (0o640, 0o604):
        secret.chmod(mode)
        with pytest.raises(KeyFileError, match="chmod 600"):
            read_pair(secret)


def test_files_that_hold_no_key(tmp_path: Path) -> None:
    public, secret = make_pair(str(tmp_path / "lab"))
    _, other = make_pair(str(tmp_path / "other"))
    with pytest.raises(KeyFileError, match=r"no secret key; give the file of the pair that ends in .key_secret"):
        read_pair(public)
    mixed = tmp_path / "mixed"
    line = next(line for line in other.read_text().splitlines() if "secret-key" in line)
    mixed.write_text(public.read_text() + line)
    mixed.chmod(0o600)
    with pytest.raises(KeyFileError, match="no pair"):
        read_pair(mixed)
    for content in (b"", b'public-key = "short"', b'public-key = "' + b"~" * 40 + b'"', bytes(range(256)) * 100):
        (tmp_path / "bad").write_bytes(content)
        with pytest.raises(KeyFileError, match="holds no public key"):
            read_public(tmp_path / "bad")
    with pytest.raises(KeyFileError, match=r"no such file; `evis remote keys NAME` makes"):
        read_public(tmp_path / "none")
    with pytest.raises(KeyFileError, match="is no file"):
        read_public(tmp_path)
    assert secret.exists()
