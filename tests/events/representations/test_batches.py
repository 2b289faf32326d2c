"""Batches, windows, places that do not exist, arrays of other makers, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp
from plain_definitions import Columns, some_events, voxels

from evis.events import Events
from evis.events.representations import TimeSurface, count_image, event_stack, time_surface, voxel_grid
from msgs.camera import EventPacket
from msgs.header import Header

SIZE = {"height": 6, "width": 9}
MAKERS: dict[str, Any] = {
    "voxel_grid": lambda e, **k: voxel_grid(e, 4, **k),
    "event_stack": lambda e, **k: event_stack(e, 4, **k),
    "by_count": lambda e, **k: event_stack(e, 4, by="count", **k),
    "count_image": count_image,
    "time_surface": lambda e, **k: time_surface(e, 1_000_000, **k),
}


def three_environments() -> tuple[list[Columns], Columns]:
    """Of different lengths, one empty; apart and as one batch."""
    parts = [some_events(150, seed=1), some_events(0, seed=2), some_events(260, seed=5)]
    whole = {n: np.concatenate([part[n] for part in parts]) for n in "txyp"}
    return parts, whole | {"env_offsets": np.array([0, 150, 150, 410])}


@pytest.mark.parametrize("name", MAKERS)
def test_a_batch_is_its_environments(name: str) -> None:
    parts, batch = three_environments()
    made = MAKERS[name](batch, **SIZE)
    for e, part in enumerate(parts):
        np.testing.assert_array_equal(made.values[e], MAKERS[name](part, **SIZE).values)
    assert made.outside.shape == (3, 2)


def test_normalising_is_per_environment() -> None:
    _, batch = three_environments()
    made = voxel_grid(batch, 4, normalise=True, **SIZE).values
    for e in (0, 2):
        filled = made[e][made[e] != 0].astype(float)
        assert abs(filled.mean()) < 1e-5 and abs(filled.std() - 1) < 1e-5


def test_windows_of_each_environment() -> None:
    parts, batch = three_environments()
    first, last = np.array([6, 7, 8]) * 1_000_000, np.array([9, 12, 14]) * 1_000_000
    made = voxel_grid(batch, 4, window=(first, last), **SIZE)
    for e, part in enumerate(parts):
        window = (int(first[e]), int(last[e]))
        np.testing.assert_allclose(made.values[e], voxels(part, 4, (6, 9), "signed", window), atol=1e-5)
        inside = (part["t"] >= first[e]) & (part["t"] <= last[e])
        assert made.outside[e].tolist() == [(~inside).sum(), 0]


@pytest.mark.parametrize("name", MAKERS)
def test_events_outside_the_array_are_counted(name: str) -> None:
    events = some_events()
    made = MAKERS[name](events, height=4, width=9)
    beyond = int((events["y"] >= 4).sum())
    assert beyond > 0 and made.outside.tolist() == [0, beyond]
    inside = {n: c[events["y"] < 4] for n, c in events.items()}
    if name == "count_image":
        assert made.values.sum() == len(inside["t"])


def test_coordinates_that_no_array_has() -> None:
    """Negative ones and such beyond 16 or 32 bits do not come round to a pixel."""
    x = np.array([-1, 65536 + 3, 2**32 + 3, 3])
    events = {"t": np.arange(4), "x": x, "y": np.zeros(4, int), "p": np.ones(4, int)}
    made = count_image(events, polarity="merged", **SIZE)
    assert made.outside.tolist() == [0, 3] and made.values.sum() == made.values[0, 3] == 1


@pytest.mark.parametrize("name", MAKERS)
@pytest.mark.parametrize("kind", ["int64", "structured", "Events", "Warp"])
def test_the_same_of_any_container(name: str, kind: str) -> None:
    events = some_events()
    expected = MAKERS[name](events, **SIZE)
    given: Any = {n: c.astype(np.int64) for n, c in events.items()}
    if kind == "structured":
        given = np.zeros(len(events["t"]), [("x", "<i2"), ("y", "<i2"), ("t", "<i8"), ("p", "?")])
        for n in "txyp":
            given[n] = events[n]
    elif kind == "Events":
        given = Events.of(**events)
    elif kind == "Warp":
        given = {n: wp.array(c, device="cpu") for n, c in events.items()}
    made = MAKERS[name](given, **SIZE)
    assert isinstance(made.values, wp.array if kind == "Warp" else np.ndarray)
    for have, want in zip(made, expected):
        np.testing.assert_array_equal(have.numpy() if kind == "Warp" else have, want)


def test_a_packet_says_its_size_and_environments() -> None:
    _, batch = three_environments()
    columns = {n: batch[n] for n in "txyp"}
    packet = EventPacket(Header(0), batch["env_offsets"], **columns, width=9, height=6)
    np.testing.assert_array_equal(count_image(packet).values, count_image(batch, **SIZE).values)


def test_some_environments_of_a_surface_begin_anew() -> None:
    _, batch = three_environments()
    nothing = {n: c[:0] for n, c in batch.items()} | {"env_offsets": np.zeros(4, int)}
    kept = TimeSurface(1_000_000, **SIZE)
    before = kept.update(batch, at=15_000_000).values
    kept.reset([2])
    after = kept.update(nothing, at=[15_000_000, 15_000_000, 0]).values
    np.testing.assert_array_equal(after[0], before[0])
    assert before[2].any() and not after[2].any()


BAD: list[tuple[str, Any]] = [
    ("have no 'p'", lambda e: voxel_grid({n: e[n] for n in "txy"}, 2, **SIZE)),
    ("t is float64, must be whole nanoseconds", lambda e: voxel_grid(e | {"t": e["t"] * 1e-9}, 2, **SIZE)),
    ("x is float32, must be whole numbers", lambda e: voxel_grid(e | {"x": e["x"].astype(np.float32)}, 2, **SIZE)),
    ("equal length, not t \\[400\\], x \\[3\\]", lambda e: voxel_grid(e | {"x": e["x"][:3]}, 2, **SIZE)),
    ("bins is 0", lambda e: voxel_grid(e, 0, **SIZE)),
    ("bins is 2.5", lambda e: event_stack(e, 2.5, **SIZE)),  # type: ignore[arg-type]
    ("polarity is 'both'; it must be signed, split or merged", lambda e: count_image(e, polarity="both", **SIZE)),
    ("by is 'size'", lambda e: event_stack(e, 2, by="size", **SIZE)),
    ("goes over all events", lambda e: event_stack(e, 2, by="count", window=(0, 1), **SIZE)),
    ("do not say their height", lambda e: count_image(e)),
    ("begins at 9 ns, after its end at 3 ns", lambda e: count_image(e, window=(9, 3), **SIZE)),
    ("the window is 7; it must be \\(t0, t1\\), two times in ns", lambda e: count_image(e, window=7, **SIZE)),
    ("the window is \\(7,\\); it must be", lambda e: voxel_grid(e, 2, window=(7,), **SIZE)),  # type: ignore[arg-type]
    ("normalise is 'x'; it must be True or False", lambda e: voxel_grid(e, 2, normalise="x", **SIZE)),
    ("normalise is 'False'; it must be", lambda e: voxel_grid(e, 2, normalise="False", **SIZE)),
    ("must be whole ns", lambda e: count_image(e, window=(0.0, 0.1), **SIZE)),
    ("ascend from 0 to the number of events, 400", lambda e: count_image(e | {"env_offsets": [0, 3]}, **SIZE)),
    ("tau_ns is 0", lambda e: time_surface(e, 0, **SIZE)),
    ("decay is 'slow'", lambda e: time_surface(e, 5, decay="slow", **SIZE)),
]


@pytest.mark.parametrize(("text", "call"), BAD, ids=[text for text, _ in BAD])
def test_bad_input_is_named(text: str, call: Any) -> None:
    with pytest.raises(ValueError, match=text):
        call(some_events())


def test_a_surface_does_not_go_back() -> None:
    kept = TimeSurface(1000, **SIZE)
    kept.update(some_events())
    with pytest.raises(ValueError, match="time goes back to 5 ns"):
        kept.update(some_events(0), at=5)
    with pytest.raises(ValueError, match="the surface has 1 x 6 x 9"):
        kept.update(three_environments()[1])


@pytest.mark.parametrize("name", MAKERS)
def test_times_as_far_apart_as_can_be(name: str) -> None:
    """As a damaged file has them: more than 2^63 ns apart nothing is sensible, and nothing is written elsewhere."""
    t = np.array([-(2**63) + 1, -5, 0, 7, 2**63 - 1])
    events = {"t": t, "x": np.arange(5), "y": np.arange(5), "p": np.ones(5, int)}
    made = MAKERS[name](events, **SIZE)
    assert np.isfinite(made.values).all() and made.outside.tolist() == [0, 0]


@pytest.mark.gpu
@pytest.mark.parametrize("name", MAKERS)
def test_the_same_on_a_gpu(name: str) -> None:
    """Whole numbers exactly; a float may differ by its last bit."""
    _, batch = three_environments()
    there = {n: wp.array(batch[n], device="cuda") for n in "txyp"} | {"env_offsets": batch["env_offsets"]}
    made = MAKERS[name](there, **SIZE)
    assert made.values.device.is_cuda
    np.testing.assert_allclose(made.values.numpy(), MAKERS[name](batch, **SIZE).values, rtol=1e-6)
    np.testing.assert_array_equal(made.values.numpy(), MAKERS[name](there, **SIZE).values.numpy())
