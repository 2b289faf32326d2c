"""Messages for the bag tests, and their comparison bit by bit."""

from __future__ import annotations

import dataclasses
import sqlite3
from pathlib import Path

import numpy as np

from msgs.camera import (
    CameraInfo,
    Depth,
    EventPacket,
    EventSignal,
    Frames,
    Ids,
    Image,
    Imu,
    Keyframe,
    Labels,
    Motion,
    Normal,
    Samples,
    Trigger,
)
from msgs.diagnostics import Diagnostics
from msgs.header import Header, Message
from msgs.world import Action, Clock, Reset, WorldState


def same(a: Message, b: Message) -> bool:
    """Equal in every field, arrays in every bit."""
    if type(a) is not type(b) or a.header != b.header or a.scalars() != b.scalars():
        return False
    mine, other = a.arrays(), b.arrays()
    if mine.keys() != other.keys():
        return False
    return all(
        mine[n].dtype == other[n].dtype and mine[n].shape == other[n].shape and mine[n].tobytes() == other[n].tobytes()
        for n in mine
    )


def copied(message: Message) -> Message:
    """With arrays of its own."""
    return dataclasses.replace(message, **{n: np.array(a) for n, a in message.arrays().items()})


def still_but_for(pose: np.ndarray, moving: list[int]) -> np.ndarray:
    """Poses [E, S, N, 7] whose other bodies stand where they are at the last sub-step."""
    return np.where(np.isin(np.arange(pose.shape[2]), moving)[:, None], pose, pose[:, -1:])


def scene(k: int, envs: int = 1, seed: int = 0) -> dict[str, Message]:
    """One message of every topic at the k-th keyframe."""
    rng = np.random.default_rng([seed, k])
    e, h, w, s, n = envs, 5, 7, 3, 4
    stamp = round(k * 1e9 / 30)

    def header() -> Header:
        return Header(stamp, k, "sim", 0)

    def f32(*shape: int) -> np.ndarray:
        return rng.normal(size=shape).astype(np.float32)

    sizes = rng.integers(0, 9, e)
    count = int(sizes.sum())
    t = np.concatenate([np.sort(rng.integers(max(stamp - 10**6, 0), stamp + 1, c)) for c in sizes])
    ids = rng.integers(0, 9, (e, h, w)).astype(np.int32)
    rows = rng.integers(0, e, 6).astype(np.int32)
    episodes = np.zeros(e, np.int32)
    moving = [[1, 3], [], [0, 1, 2, 3]][k % 3]
    depth = f32(e, h, w)
    depth[0, 0, 0] = np.inf
    lists = np.append(0, np.sort(rng.integers(0, e * h * w + 1, e * h * w))).astype(np.int32)
    lists[-1] = e * h * w
    return {
        "/state": WorldState.dense(
            header(),
            np.arange(s) * 1000 + stamp,
            still_but_for(rng.normal(size=(e, s, n, 7)), moving),
            np.where(np.isin(np.arange(n), moving)[:, None], rng.normal(size=(e, s, n, 6)), 0.0),
            episodes,
            qpos=rng.normal(size=(e, s, 2)),
            contact_env=rows,
            contact_force=rng.normal(size=(6, 3)),
            names=["cam0", "a", "link/ä", "b"],
        ),
        "/action": Action(header(), rng.normal(size=(e, 3))),
        "/reset": Reset(header(), rows, np.arange(6, dtype=np.int64)),
        "/clock": Clock(header(), float(rng.normal())),
        "/diagnostics": Diagnostics(
            Header(1_790_000_000_000_000_001 + k, k, "wall"), "physics", "ok", "fine", {"x": float("nan"), "n": 2**60}
        ),
        "/cam0/info": CameraInfo(
            header(),
            np.eye(3) * 3,
            np.array([0.1, -0.2]),
            width=w,
            height=h,
            envs=e,
            distortion_model="plumb_bob",
            instances=["background", "disk"],
            sensor={"threshold": 0.2, "nested": {"a": [1, None, True]}},
        ),
        "/cam0/keyframe": Keyframe(header(), episodes, np.exp(f32(e, h, w, 3))),
        "/cam0/depth": Depth(header(), depth),
        "/cam0/motion": Motion(header(), f32(e, h, w, 2)),
        "/cam0/ids": Ids(header(), ids),
        "/cam0/normal": Normal(header(), f32(e, h, w, 3)),
        "/cam0/frames": Frames(header(), np.array([stamp - 5, stamp]), episodes, f32(e, 2, h, w)),
        "/cam0/samples": Samples(
            header(),
            np.array([stamp - 5, stamp]),
            episodes,
            lists,
            np.arange(1, e * h * w + 1, dtype=np.int32),
            luminance=f32(e, 2, h, w),
            further=f32(e * h * w),
        ),
        "/cam0/events": EventPacket(
            header(),
            np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
            t.astype(np.int64),
            rng.integers(0, w, count).astype(np.uint16),
            rng.integers(0, h, count).astype(np.uint16),
            rng.integers(0, 2, count).astype(np.uint8),
            c=rng.integers(0, 3, count).astype(np.uint8),
            width=w,
            height=h,
            t0_ns=max(stamp - 10**6, 0),
            lost=k,
        ),
        "/cam0/signal": EventSignal(
            header(),
            np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
            rng.integers(0, 2, count).astype(np.uint8),
        ),
        "/cam0/labels": Labels(
            header(),
            flow=f32(e, h, w, 2),
            segmentation=ids,
            box=f32(6, 4),
            box_env=rows,
            box_id=np.arange(6, dtype=np.int32),
            pose=rng.normal(size=(e, n, 7)),
            names=["a"],
        ),
        "/cam0/imu": Imu(
            header(), np.arange(2) + stamp, rng.normal(size=(2, 3)), rng.normal(size=(2, 3)), rng.normal(size=2)
        ),
        "/cam0/trigger": Trigger(header(), np.array([stamp]), np.array([1], np.uint8), np.array([0], np.uint8)),
        "/cam0/image": Image(header(), rng.integers(0, 255, (h, w, 3)).astype(np.uint8), "rgb8", 12),
    }


def mono_payloads(path: Path) -> list[bytes]:
    """CDR messages of a ROS 2 .db3 bag."""
    with sqlite3.connect(f"file:{path}?mode=ro&immutable=1", uri=True) as db:
        return [row[0] for row in db.execute("select data from messages order by timestamp, id")]
