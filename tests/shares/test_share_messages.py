"""Messages that are cut into shares and joined again, and which messages of the shares belong together."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evis.shares.bounds import bounds
from evis.shares.cut import can_be_cut, cut, environments
from evis.shares.joined import complete, join, join_infos
from msgs.camera import CameraInfo, EventPacket, Frames, Keyframe, Labels, Samples
from msgs.header import Header, Message
from msgs.world import WorldState
from nodes.environment_join.alignment import Alignment

ENVS = 5


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 16), st.integers(0, 200))
def test_everything_is_dealt_out_in_order(shares: int, more: int) -> None:
    made = bounds(shares + more, shares)
    assert [i for own in made for i in range(shares + more)[own]] == list(range(shares + more))
    lengths = [own.stop - own.start for own in made]
    assert max(lengths) - min(lengths) <= 1 and len(made) == shares


def test_nobody_gets_nothing() -> None:
    with pytest.raises(ValueError, match="2 cannot be dealt out in 3 shares"):
        bounds(2, 3)


def state() -> WorldState:
    rng = np.random.default_rng(1)
    made = WorldState.dense(
        Header(7, episode=2), np.array([3, 7]), rng.random((ENVS, 2, 3, 7)), rng.random((ENVS, 2, 3, 6)),
        np.arange(ENVS, dtype=np.int32), names=["a", "b", "c"],
    )  # fmt: skip
    made.contact_env = np.array([0, 1, 1, 4], np.int32)
    made.contact_body = np.arange(8, dtype=np.int32).reshape(4, 2)
    made.contact_position = made.contact_normal = made.contact_force = rng.random((4, 3))
    made.contact_distance = rng.random(4)
    return made


def parts_of(message: Any, shares: int) -> list[Message]:
    return [replace(message, **cut(message, own)) for own in bounds(environments(message), shares)]


def joined(parts: list[Message | None], shares: int) -> Any:
    made = join(parts, bounds(ENVS, shares))
    return made.written({name: np.empty(shape, dtype) for name, (shape, dtype) in made.shapes().items()})


def assert_same(a: Message, b: Message) -> None:
    assert a.arrays().keys() == b.arrays().keys() and a.scalars() == b.scalars()
    for name, array in a.arrays().items():
        other = b.arrays()[name]
        assert array.dtype == other.dtype and array.shape == other.shape and array.tobytes() == other.tobytes(), name


@pytest.mark.parametrize("shares", [1, 2, 3, 5])
def test_what_is_cut_and_joined_is_as_it_was(shares: int) -> None:
    whole = state()
    parts = parts_of(whole, shares)
    for part in parts:
        part.check()
    assert_same(joined([*parts], shares), whole)


def test_contacts_tell_the_environment_among_the_shares() -> None:
    first, second = parts_of(state(), 2)
    assert isinstance(first, WorldState) and isinstance(second, WorldState)
    assert first.contact_env.tolist() == [0, 1, 1] and second.contact_env.tolist() == [1]


def packet(counts: list[int]) -> EventPacket:
    n = sum(counts)
    columns: dict[str, Any] = {"t": np.arange(n), "x": np.arange(n, dtype=np.uint16), "y": np.zeros(n, np.uint16)}
    offsets = np.cumsum([0, *counts])
    return EventPacket(Header(9), offsets, **columns, p=np.ones(n, np.uint8), width=4, height=3, t0_ns=5)


def test_events_are_joined_by_environment() -> None:
    whole = joined([packet([2, 0, 3]), packet([1, 4])], 2)
    whole.check()
    assert whole.env_offsets.tolist() == [0, 2, 2, 5, 6, 10]
    assert whole.x.tolist() == [0, 1, 2, 3, 4, 0, 1, 2, 3, 4] and (whole.width, whole.t0_ns) == (4, 5)


def test_who_has_no_packet_has_no_events() -> None:
    whole = joined([None, packet([1, 4])], 2)
    assert whole.env_offsets.tolist() == [0, 0, 0, 0, 1, 5] and len(whole.t) == 5


def test_frames_count_together_and_share_their_stamps() -> None:
    def frames(envs: int, last: int = 4) -> Frames:
        light = np.ones((envs, 2, 3, 4), np.float32)
        return Frames(Header(4), np.array([2, last]), np.zeros(envs, np.int32), light, filled=envs)

    whole = joined([frames(3), frames(2)], 2)
    assert whole.luminance.shape == (5, 2, 3, 4) and whole.t.tolist() == [2, 4] and whole.filled == 5
    with pytest.raises(ValueError, match=r"Frames\.t each, which must be one for all"):
        joined([frames(3), frames(2, 5)], 2)
    assert not complete([frames(3), None]) and complete([packet([1]), None])
    with pytest.raises(ValueError, match="lacks its Frames"):
        joined([frames(3), None], 2)


def test_samples_begin_behind_those_of_the_other_share() -> None:
    def samples(envs: int, each: int) -> Samples:
        pixels = envs * 6
        return Samples(
            Header(4), np.array([4]), np.zeros(envs, np.int32), np.arange(pixels + 1, dtype=np.int32) * each,
            np.tile(np.arange(1, each + 1, dtype=np.int32), pixels), np.ones((envs, 1, 2, 3), np.float32),
            further=np.full(pixels * each, each, np.float32),
        )  # fmt: skip

    whole = joined([samples(3, 2), samples(2, 1)], 2)
    whole.check()
    assert whole.first[-1] == len(whole.further) == 48 and whole.first[19] - whole.first[18] == 1


def test_a_share_whose_environments_all_begin_an_episode_holds_its_frame_for_the_gap_of_the_others() -> None:
    """As an environment does that begins one while others of its share go on."""

    def frames(envs: int, t: list[int]) -> Frames:
        light = np.arange(envs * len(t), dtype=np.float32).reshape(envs, len(t), 1, 1)
        own = np.arange(envs * 4, dtype=np.int64).reshape(envs, 4)
        return Frames(Header(4), np.array(t), np.zeros(envs, np.int32), light, own=own, own_t=np.tile(t, (envs, 1)))

    whole = joined([frames(3, [4]), frames(2, [2, 4])], 2)
    whole.check()
    assert whole.t.tolist() == [2, 4] and whole.own_t.tolist() == [[4, 4]] * 3 + [[2, 4]] * 2
    assert whole.luminance[:, :, 0, 0].tolist() == [[0, 0], [1, 1], [2, 2], [0, 1], [2, 3]]
    assert joined([frames(3, [4]), frames(2, [4])], 2).luminance.shape == (5, 1, 1, 1)
    with pytest.raises(ValueError, match=r"Frames\.t each, which must be one for all"):
        joined([frames(3, [3]), frames(2, [2, 4])], 2)


def test_such_a_share_has_no_further_samples() -> None:
    def samples(t: list[int], further: int) -> Samples:
        first = np.minimum(np.arange(3, dtype=np.int32), further)
        light, offset = np.ones((1, len(t), 1, 2), np.float32), np.ones(further, np.int32)
        return Samples(
            Header(4), np.array(t), np.zeros(1, np.int32), first, offset, light, further=light.ravel()[:further]
        )

    whole = joined([samples([2, 4], 2), samples([4], 0)], 2)
    whole.check()
    assert whole.luminance.shape == (2, 2, 1, 2) and whole.first.tolist() == [0, 1, 2, 2, 2]


def test_rows_of_boxes_tell_their_environment_among_all() -> None:
    def boxes(envs: list[int]) -> Labels:
        n = len(envs)
        box, ids = np.zeros((n, 4), np.float32), np.ones(n, np.int32)
        return Labels(Header(4), box=box, box_env=np.array(envs, np.int32), box_id=ids)

    assert joined([boxes([0, 2, 2]), boxes([0, 1])], 2).box_env.tolist() == [0, 2, 2, 3, 4]


def info(envs: int, focal: float, **drawn: Any) -> CameraInfo:
    return CameraInfo(Header(0), np.diag([focal, focal, 1.0]), np.zeros(0), envs=envs, drawn=drawn)


def test_lenses_are_told_apart_where_they_differ() -> None:
    same = join_infos([info(3, 100.0), info(2, 100.0)])
    assert same.envs == 5 and same.env_k is None and same.env_distortion is None
    other = join_infos([info(3, 100.0, speed=[1, 2, 3]), info(2, 120.0, speed=[4, 5], tilt=[6, 7])])
    other.check()
    assert other.env_k is not None and other.env_k[:, 0, 0].tolist() == [100, 100, 100, 120, 120]
    assert other.k[0, 0] == 100 and other.drawn == {"speed": [1, 2, 3, 4, 5], "tilt": [None, None, None, 6, 7]}


def test_so_are_baselines() -> None:
    apart = [replace(info(2, 100.0), baseline=0.1), replace(info(1, 100.0), baseline=0.2)]
    other = join_infos(apart)
    other.check()
    assert other.env_baseline is not None and other.env_baseline.tolist() == [0.1, 0.1, 0.2] and other.baseline == 0.1
    assert join_infos([apart[0], apart[0]]).env_baseline is None


def test_only_what_tells_its_environments_can_be_cut() -> None:
    assert can_be_cut(WorldState) and can_be_cut(Keyframe)
    assert not can_be_cut(EventPacket) and not can_be_cut(Samples)


def of(stamp: int, seq: int) -> Message:
    return Keyframe(Header(stamp, seq), np.zeros(1, np.int32))


def stamps(rows: Any) -> list[list[int | None]]:
    return [[None if m is None else m.header.stamp_ns for m in row] for row in rows]


def test_messages_of_one_stamp_belong_together() -> None:
    align = Alignment(2)
    for seq, stamp in enumerate((1, 2, 3)):
        align.put(0, of(stamp, seq))
    assert stamps(align.complete()) == []
    align.put(1, of(1, 0))
    align.put(1, of(2, 1))
    assert stamps(align.complete()) == [[1, 1], [2, 2]]


def test_a_second_message_of_a_stamp_that_only_one_share_has() -> None:
    align = Alignment(2)
    for seq, stamp in enumerate((1, 1, 2)):
        align.put(0, of(stamp, seq))
    align.put(1, of(1, 0))
    align.put(1, of(2, 1))
    assert stamps(align.complete()) == [[1, 1], [1, None], [2, 2]]
    align.put(1, of(2, 2))
    assert stamps(align.complete()) == [] and stamps(align.complete(over=True)) == [[None, 2]]


def test_what_was_lost_on_the_way_is_not_taken_for_nothing() -> None:
    align = Alignment(2)
    for seq, stamp in enumerate((1, 2, 3)):
        align.put(0, of(stamp, seq))
    align.put(1, of(1, 0))
    align.put(1, of(3, 2))
    assert stamps(align.complete()) == [[1, 1], [3, 3]] and align.lost == 1


def test_labels_of_held_back_events_need_no_share_without_events() -> None:
    """At the end of a run a sensor that holds nothing back sends no packet, and its labeler no labels."""
    events = {"event_env": np.zeros(3, np.int32), "event_instance": np.arange(3, dtype=np.int32)}
    events["event_flow"] = np.zeros((3, 2), np.float32)
    held = Labels(Header(7), **events)
    for parts, first in ([held, None], 0), ([None, held], bounds(ENVS, 2)[1].start):
        assert complete(parts)
        made = joined(parts, 2)
        assert made.event_env.tolist() == [first] * 3 and made.event_instance.tolist() == [0, 1, 2]
    assert not complete([Labels(Header(7), depth=np.zeros((3, 2, 2), np.float32), **events), None])
