"""Arrays saved by name and written back: of numbers, vectors and structs, as numpy's files have them."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
import warp as wp

from evis.gpu.saved_arrays import joined, part_of, saved, write_back


@wp.struct
class Place:
    """Holds fields of several sizes, with a gap between them."""

    number: wp.int32
    at: wp.float64
    flag: wp.uint8


def some(seed: int, device: str = "cpu") -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    places: Any = np.zeros((2, 5), Place.numpy_dtype())  # type: ignore[attr-defined]
    places["number"], places["at"], places["flag"] = rng.integers(0, 99, (2, 5)), rng.random((2, 5)), 1
    return {
        "level": wp.array(rng.random(7), dtype=wp.float64, device=device),
        "counts": wp.array(rng.integers(0, 9, (4, 2)), dtype=wp.vec2i, device=device),
        "place": wp.array(places, dtype=Place, device=device),
        "none": wp.zeros(0, dtype=wp.int64, device=device),
    }


def there_and_back(device: str) -> None:
    one, other = some(1, device), some(2, device)
    file = io.BytesIO()
    np.savez(file, **joined({"pixels": saved(one)}))
    file.seek(0)
    addresses = {name: array.ptr for name, array in other.items()}
    write_back(other, part_of(dict(np.load(file)), "pixels"))
    for name, array in other.items():
        assert array.ptr == addresses[name]  # whoever has the array sees it
        assert array.numpy().tolist() == one[name].numpy().tolist()


def test_there_and_back() -> None:
    there_and_back("cpu")


@pytest.mark.gpu
def test_there_and_back_on_a_gpu() -> None:
    there_and_back("cuda")


def test_what_is_saved_is_a_copy() -> None:
    arrays = some(1)
    state = saved(arrays)
    before = {name: values.copy() for name, values in state.items()}
    write_back(arrays, saved(some(2)))
    assert all(np.array_equal(state[name], before[name]) for name in state)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"level": np.zeros(6)}, r"its level is float64 \[6\], and is float64 \[7\] here"),
        ({"place.at": np.zeros((2, 5), np.float32)}, r"its place.at is float32 \[2, 5\], and is float64"),
        ({"more": np.zeros(1)}, "it has an array that nobody knows, more"),
        ({"counts": None}, "it lacks counts"),
    ],
)
def test_other_arrays_are_refused_and_nothing_is_written(change: dict[str, Any], text: str) -> None:
    arrays, before = some(1), saved(some(1))
    state = {name: values for name, values in (saved(some(2)) | change).items() if values is not None}
    with pytest.raises(ValueError, match=text):
        write_back(arrays, state)
    now = saved(arrays)
    assert all(np.array_equal(now[name], before[name]) for name in before)
