"""`evis.EventSensor` with further samples of single pixels between its frames."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp

import evis

MS = 1_000_000
NAMES = ("t", "x", "y", "p")
SHAPE = (2, 5, 6)
"""E, H, W."""


def events_of(*made: Any) -> list[np.ndarray]:
    return [np.concatenate([np.asarray(getattr(m, n)) for m in made]) for n in NAMES]


def film(rng: np.random.Generator, colour: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Frames [E, 9, H, W(, 3)] that all have sight of each other, and their stamps."""
    tail = (3,) if colour else ()
    return np.exp(rng.normal(0, 0.4, (SHAPE[0], 9, *SHAPE[1:], *tail))).astype(np.float32), np.arange(9) * MS + 5


@pytest.mark.parametrize("colour", [False, True])
def test_what_is_further_in_one_call_is_frames_in_another(colour: bool) -> None:
    """Every third frame is a frame and the others are further samples of all pixels, in any order: the same events."""
    frames, t = film(np.random.default_rng(1), colour)
    whole = evis.EventSensor(*SHAPE[1:], SHAPE[0], colour=colour)
    expected = events_of(whole(frames[:, :1], t[:1]), whole(frames[:, 1:], t[1:]))
    sensor = evis.EventSensor(*SHAPE[1:], SHAPE[0], colour=colour)
    made = [sensor(frames[:, :1], t[:1])]
    for keys in ([3, 6], [8]):
        before = 0 if keys[0] == 3 else 6
        between = [k for k in range(before + 1, keys[-1]) if k not in keys]
        env, k, y, x = (a.ravel() for a in np.meshgrid(range(SHAPE[0]), between, *map(range, SHAPE[1:])))
        order = np.random.default_rng(2).permutation(len(k))
        env, k, y, x = (a[order] for a in (env, k, y, x))
        further = evis.Further.of_pixels(SHAPE, y, x, t[k] - t[before], frames[env, k, y, x], env)
        assert further.first[-1] == len(k) == np.prod(SHAPE) * len(between)
        made.append(sensor(frames[:, keys], t[keys], further=further))
    found = events_of(*made)
    assert len(found[0]) > 100

    # Environments come one after the other in each call.
    def ordered(columns: list[np.ndarray]) -> list[tuple[int, ...]]:
        return sorted(zip(*(c.tolist() for c in columns)))

    assert ordered(found) == ordered(expected)


@pytest.mark.parametrize("kind", ["warp", "dlpack"])
def test_arrays_of_any_kind(kind: str) -> None:
    frames, t = film(np.random.default_rng(3))
    further = evis.Further.of_pixels(SHAPE, [1, 4, 1], [2, 5, 2], [9, 400, 77], [3.0, 0.2, 0.1], [0, 1, 0])
    assert further.offset.tolist() == [9, 77, 400] and further.value.tolist() == np.float32([3, 0.1, 0.2]).tolist()

    class Foreign:
        def __init__(self, values: np.ndarray) -> None:
            self.values = values

        def __dlpack__(self, **_: Any) -> Any:
            return self.values.__dlpack__()

        def __dlpack_device__(self) -> Any:
            return self.values.__dlpack_device__()

    def sensed(given: evis.Further) -> list[np.ndarray]:
        sensor = evis.EventSensor(*SHAPE[1:], SHAPE[0])
        sensor(frames[:, :1], t[:1])
        return events_of(sensor(frames[:, 1:], t[1:], further=given))

    other: Any = Foreign if kind == "dlpack" else lambda values: wp.array(values, device="cpu")
    as_other = evis.Further(*(other(a) for a in (further.first, further.offset, further.value)))
    assert all(np.array_equal(a, b) for a, b in zip(sensed(as_other), sensed(further)))


@pytest.mark.parametrize(
    ("parameters", "told"),
    [({"model": "esim"}, "esim"), ({"crossing": "cubic"}, "crossing=cubic"), ({"defocus_px": 1.0}, "defocus")],
)
def test_what_takes_frames_alone_says_so(parameters: dict[str, Any], told: str) -> None:
    sensor = evis.EventSensor(5, 6, **parameters)
    further = evis.Further.of_pixels((5, 6), [1], [2], [9], [1.5])
    with pytest.raises(ValueError, match=f"further samples between the frames, but .*{told}"):
        sensor(np.ones((2, 5, 6), np.float32), np.array([0, MS]), further=further)


def test_a_pixel_that_is_not_there_is_named() -> None:
    with pytest.raises(ValueError, match="x 6 to 6; there are 0 to 5"):
        evis.Further.of_pixels((5, 6), [1], [6], [9], [1.5])
    with pytest.raises(ValueError, match="environment 2 to 2; there are 0 to 1"):
        evis.Further.of_pixels(SHAPE, [1], [2], [9], [1.5], [2])


@pytest.mark.parametrize(
    ("x", "offset", "value", "told"),
    [
        ([2], [2**32 + 5], [1.5], "an offset of 4294967301 ns; give frames in between"),
        ([2], [-3_000_000_000], [1.5], "an offset of -3000000000 ns"),
        ([2], [9.7], [1.5], "offset of float64"),
        ([2.5], [9], [1.5], "x of float64"),
        ([2, 3], [9, 8], [1.5, 2.0, 2.5], "2 offsets and 3 values"),
        ([2, 3], [9, 8], [1.5], "2 offsets and 1 values"),
    ],
)
def test_numbers_that_would_be_cut_are_refused(x: list, offset: list, value: list, told: str) -> None:
    """An offset of 2^32 + 5 ns is not one of 5 ns."""
    with pytest.raises(ValueError, match=told):
        evis.Further.of_pixels((5, 6), 1, x, offset, value)
