"""Flipped bits and false types in bags: what can be read is, the rest is counted, or there is one BagError."""

from __future__ import annotations

import json

import numpy as np
import pytest

from evis.bag import BagError
from evis.bag.info import describe
from evis.bag.reader import BagReader
from evis.bag.writer import BagWriter
from msgs.camera import EventPacket
from msgs.header import Header


def bag(path):
    """Twelve packets of events, in chunks of their own."""
    with BagWriter(path) as writer:
        for k in range(12):
            t = np.arange(40, dtype=np.int64) * 1000 + k * 50_000
            x, p = np.arange(40, dtype=np.uint16), np.ones(40, np.uint8)
            offsets = np.array([0, 40], np.int64)
            packet = EventPacket(Header(k * 50_000, k, "sim"), offsets, t=t, x=x, y=x, p=p, width=64, height=64)
            writer.write("/cam0/events", packet)
    return path.read_bytes()


def test_flipped_bits(tmp_path):
    """Anywhere in the file."""
    data = bag(tmp_path / "whole.mcap")
    path = tmp_path / "a.mcap"
    read = 0
    for seed in range(80):
        rng = np.random.default_rng(seed)
        broken = bytearray(data)
        broken[int(rng.integers(0, len(data)))] ^= 1 << int(rng.integers(0, 8))
        path.write_bytes(broken)
        try:
            describe(path)
            with BagReader(path) as reader:
                read += sum(1 for _ in reader.messages())
        except BagError as error:
            assert "\n" not in str(error)
    assert read > 80  # most flips cost no more than a message


@pytest.mark.parametrize("counted", [5, [1], "many", {"events": "x", "t_first_ns": [], "t_last_ns": None}])
def test_false_types(counted, tmp_path, monkeypatch):
    """A closing text whose counts are no counts is a damaged message, not a mistake of the program."""
    from evis.bag.ros import events

    monkeypatch.setattr(events, "summary", lambda packet: counted)
    bag(tmp_path / "a.mcap")
    monkeypatch.undo()
    about = describe(tmp_path / "a.mcap")
    assert not about["complete"] and "damaged" in about["problem"]
    json.dumps(about)
