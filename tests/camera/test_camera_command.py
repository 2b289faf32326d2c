"""`evis camera` on recordings and emulated cameras."""

from __future__ import annotations

import argparse
import json
import sys

import numpy as np
import pytest
from camera_rig import write
from usb_rig import random_recording

from evis.cli import main
from evis.cli.machine import camera
from evis.config.params import in_full
from nodes.camera.file_source import FileSource


def call(capsys, *arguments: str) -> str:
    parser = argparse.ArgumentParser()
    camera.add_arguments(parser)
    assert camera.run(parser.parse_args(arguments)) == 0
    return capsys.readouterr().out


def test_list_without_cameras(capsys, monkeypatch):
    """An empty list, and for people what is supported."""
    monkeypatch.setattr("nodes.camera.find.list_devices", lambda: [])
    assert json.loads(call(capsys, "list", "--json")) == []
    assert "no camera found" in call(capsys, "list")


def test_list_without_libusb(capsys, monkeypatch):
    """That no camera was found is not said where nobody could look."""
    monkeypatch.setattr("usb.backend.libusb1.get_backend", lambda: None)
    monkeypatch.setitem(sys.modules, "libusb_package", None)
    assert main(["camera", "list"]) == 1
    told = capsys.readouterr()
    assert told.out == "" and "libusb-1.0 was not found: `pip install 'evis[usb]'`" in told.err


def test_info(capsys, tmp_path):
    """What the driver says."""
    path = write(tmp_path / "a.raw", [1000])
    about = json.loads(call(capsys, "info", "--file", str(path), "--json"))
    assert (about["width"], about["height"], about["encoding"], about["clock"]) == (64, 48, "evt3", "device:a.raw")
    assert "64" in call(capsys, "info", "--emulate", str(path))


def test_stream(capsys, tmp_path):
    """A line per packet and a total."""
    path = str(write(tmp_path / "a.npz", np.arange(1, 50) * 1_000_000))
    lines = call(capsys, "stream", "--file", path, "--pace", "fast").splitlines()
    assert len(lines) == 6 and "packets 5" in lines[-1] and "events 49" in lines[-1]
    total = json.loads(call(capsys, "stream", "--file", path, "--pace", "fast", "--duration", "0.02", "--json"))
    assert (total["packets"], total["events"]) == (2, 20)


@pytest.mark.parametrize("said", ["-1", "nan", "soon"])
def test_a_duration_that_is_none(said, capsys, tmp_path):
    """An emulated camera would have sent nothing, as if there were nothing."""
    path = str(write(tmp_path / "a.raw", [1000]))
    assert main(["camera", "stream", "--emulate", "evk4", "--file", path, "--duration", said]) == 2
    assert f"'{said}' is no duration in seconds" in capsys.readouterr().err


def test_no_camera_is_an_error(no_camera):
    """With the remedy."""
    parser = argparse.ArgumentParser()
    camera.add_arguments(parser)
    with pytest.raises(OSError, match="no event camera found"):
        camera.run(parser.parse_args(["info"]))


def test_info_parts_each_name_from_its_value(capsys):
    parser = argparse.ArgumentParser()
    camera.add_arguments(parser)
    assert camera.run(parser.parse_args(["info", "--emulate", "davis346"])) == 0
    shown = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    assert shown["sensor"] == "DAVIS346" and shown["width"] == "346" and shown["dvs_orientation"] == "0"


def test_limits_have_all_their_digits(capsys):
    """2^24 rows or lines are no 1.67772e+07; a power of ten stays short."""
    assert (in_full(2**24), in_full(1e9), in_full(0.25)) == ("16777216", "1e+09", "0.25")
    for model in ("evk4", "davis346", "dvxplorer"):
        told = call(capsys, "info", "--emulate", model, "--settings", "--json")
        numbers = [f[side] for f in json.loads(told)["settings"].values() for side in ("minimum", "maximum")]
        shown = call(capsys, "info", "--emulate", model, "--settings")
        assert all(f" {in_full(n)}" in shown or f"({in_full(n)}" in shown for n in numbers if n is not None)


@pytest.mark.parametrize("as_json", [[], ["--json"]])
def test_a_camera_that_is_unplugged_tells_what_came(capsys, tmp_path, as_json):
    """A live camera has no other end than its plug or Ctrl-C: the counts are for that."""
    random_recording(tmp_path / "a.raw", 640, 480)
    words = [
        "camera",
        "stream",
        "--emulate",
        "silkyevcam",
        "--file",
        str(tmp_path / "a.raw"),
        "--pace",
        "fast",
        *as_json,
    ]
    assert main([*words, "--faults", "short=512,stall_every=9,unplug_after=20000"]) == 1
    told = capsys.readouterr()
    lines = told.out.splitlines()
    if as_json:
        total = json.loads(lines[-1])
    else:
        total = {name: int(value) for name, value in (part.rsplit(" ", 1) for part in lines[-1].split("  "))}
        assert total["events"] == sum(int(line.split()[2]) for line in lines[:-1])
    assert total["packets"] > 0 and total["stalls"] > 0 and total["gaps"] > 0
    assert "unplugged in mid-stream" in told.err and "--reconnect" in told.err


def test_a_stream_that_is_interrupted_tells_what_came(capsys, monkeypatch, tmp_path):
    """By Ctrl-C, here after the third packet."""
    reads, read = [], FileSource.read

    def until_three(self, timeout_s):
        if len(reads) == 3:
            raise KeyboardInterrupt
        reads.append(read(self, timeout_s))
        return reads[-1]

    monkeypatch.setattr(FileSource, "read", until_three)
    path = str(write(tmp_path / "a.npz", np.arange(1, 50) * 1_000_000))
    assert main(["camera", "stream", "--file", path, "--pace", "fast", "--json"]) == 130
    total = json.loads(capsys.readouterr().out)
    assert (total["packets"], total["events"]) == (3, 30)


def test_a_camera_that_comes_back_is_told(capsys, tmp_path):
    """Without a line the command would stand still, for as long as nobody plugs it in."""
    random_recording(tmp_path / "a.npz", 346, 260)
    words = ["--file", str(tmp_path / "a.npz"), "--pace", "fast", "--reconnect"]
    faults = ["--faults", "short=1024,unplug_after=20000,replug"]
    assert main(["camera", "stream", "--emulate", "davis346", *words, *faults]) == 0
    said = capsys.readouterr().err
    assert said.index("was unplugged; waiting for it") < said.index("the camera is back")
