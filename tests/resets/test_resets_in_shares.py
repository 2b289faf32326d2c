"""Environments that begin anew while several devices share them: the bytes of a run on one device."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from graphs import Graph

from msgs.camera import EventPacket

NOISE = {"leak_rate": 20.0, "shot_rate": 20.0, "threshold_mismatch": 0.03, "threshold": 0.2}


def run(folder: Path, device: str, scene: str) -> Graph:
    """Three environments, of which single ones begin anew, with a seed of their own and without one."""
    graph = Graph(folder, scene, device=device, envs=3, seed=4, **NOISE).step(3)
    graph.ask([1], [77])
    graph.step(2)
    graph.ask([2])
    graph.step(3)
    graph.end()
    return graph


def differing(a: EventPacket, b: EventPacket) -> list[str]:
    fields = [f.name for f in dataclasses.fields(a) if f.name != "header"]
    return [f for f in fields if np.asarray(getattr(a, f)).tobytes() != np.asarray(getattr(b, f)).tobytes()]


@pytest.mark.parametrize("scene", ["spinning_disk", "falling_objects"])
def test_single_resets_give_the_same_packets(tmp_path: Path, scene: str) -> None:
    one, two = (run(tmp_path / str(n), ",".join(["cpu"] * n), scene) for n in (1, 2))
    assert [p.header.stamp_ns for p in one.packets] == [p.header.stamp_ns for p in two.packets]
    for a, b in zip(one.packets, two.packets):
        assert a.header == b.header and differing(a, b) == []
    assert sum(len(p.t) for p in one.packets) > 500
    assert two.states[-1].own is not None
