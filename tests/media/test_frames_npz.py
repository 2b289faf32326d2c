"""Frames in .npz archives: read in blocks, whatever the storage; every damage is one error."""

from __future__ import annotations

import tracemalloc
import zipfile

import numpy as np
import pytest

from evis.media.frames.open import open_frames
from evis.media.frames.source import BLOCK_BYTES, FrameOptions, FramesError

MS = 1_000_000


def collect(path, **options):
    with open_frames(path, FrameOptions(**options)) as source:
        blocks = list(source.blocks())
        about = (source.count, source.height, source.width, source.channels)
    slopes = [b.dlog_dt for b in blocks if b.dlog_dt is not None]
    return (
        np.concatenate([b.t for b in blocks]),
        np.concatenate([b.image for b in blocks]),
        np.concatenate(slopes) if slopes else None,
        about,
    )


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
@pytest.mark.parametrize("dtype", ["<f4", ">f4", "<f2", "<f8"])
def test_blocks_are_the_arrays(save, dtype, tmp_path):
    """Stored and deflated, either byte order, any float: the same frames as numpy reads, in float32."""
    rng = np.random.default_rng(1)
    luminance = rng.random((101, 7, 9)).astype(dtype)
    t = np.cumsum(rng.integers(1, 9 * MS, 101)).astype(np.uint64 if dtype == "<f8" else np.int32)
    slopes = rng.standard_normal((101, 7, 9))
    save(tmp_path / "f.npz", luminance=luminance, t=t, dlog_dt=slopes)
    got_t, image, none, about = collect(tmp_path / "f.npz")
    assert about == (101, 7, 9, 1) and none is None
    assert image.dtype == np.float32 and got_t.dtype == np.int64
    np.testing.assert_array_equal(image, luminance.astype(np.float32))
    np.testing.assert_array_equal(got_t, t.astype(np.int64))
    np.testing.assert_array_equal(collect(tmp_path / "f.npz", slopes=True)[2], slopes.astype(np.float32))


def test_rgb_becomes_luminance_or_colour(tmp_path):
    """Rec. 709 weights (ITU-R BT.709) in float64 as the truth."""
    rgb = np.random.default_rng(2).random((5, 4, 3, 3)).astype(np.float32)
    np.savez(tmp_path / "f.npz", rgb=rgb, t=np.arange(5))
    luminance = collect(tmp_path / "f.npz")[1]
    np.testing.assert_allclose(luminance, rgb.astype(float) @ [0.2126, 0.7152, 0.0722], rtol=3e-7)
    _, image, _, about = collect(tmp_path / "f.npz", colour=True)
    np.testing.assert_array_equal(image, rgb)
    assert about == (5, 4, 3, 3)


def test_rgb_beyond_float32_is_infinite_without_a_word(tmp_path, recwarn):
    """As luminance beyond it is, which the sensor counts."""
    np.savez(tmp_path / "f.npz", rgb=np.full((2, 3, 3, 3), 1e300), t=np.arange(2))
    assert np.isposinf(collect(tmp_path / "f.npz")[1]).all() and not recwarn.list


def test_fps_takes_the_place_of_t(tmp_path):
    """30000/1001 frames per second without drift, t absent or not."""
    np.savez(tmp_path / "f.npz", luminance=np.ones((1000, 1, 1), np.float32))
    t = collect(tmp_path / "f.npz", fps=30000 / 1001)[0]
    np.testing.assert_allclose(t, np.arange(1000) * 1001 / 30000 * 1e9, atol=0.51)


def test_memory_is_bounded(tmp_path):
    """120 MB of frames, deflated: a few blocks at a time."""
    with zipfile.ZipFile(tmp_path / "f.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, array in (("t", np.arange(120)), ("luminance", np.ones((120, 500, 500), np.float32))):
            with archive.open(name + ".npy", "w", force_zip64=True) as out:
                np.lib.format.write_array(out, array)
    del array
    tracemalloc.start()
    with open_frames(tmp_path / "f.npz") as source:
        count = sum(len(block.t) for block in source.blocks())
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # the decompressed block, numpy's view of it and zipfile's own buffers
    assert count == 120 and peak < 5 * BLOCK_BYTES


GOOD = {"luminance": np.ones((3, 2, 2), np.float32), "t": np.arange(3)}


@pytest.mark.parametrize(
    ("change", "options", "text"),
    [
        ({"luminance": None}, {}, "no array luminance; it has t"),
        ({"t": None}, {}, "no array t"),
        ({"luminance": np.ones((3, 2, 2), np.uint8)}, {}, r"uint8 \[3, 2, 2\], must be float32 \[T, H, W\].*PNG"),
        ({"luminance": np.ones((3, 2, 2), object)}, {}, "luminance is object"),
        ({"luminance": np.ones((3, 2), np.float32)}, {}, r"must be float32 \[T, H, W\]"),
        ({"luminance": np.ones((0, 2, 2), np.float32)}, {}, r"\[0, 2, 2\]: it holds no frames"),
        ({"luminance": None, "t": None, "frames": np.ones((3, 2, 2))}, {}, "it has frames; save it by np.savez"),
        ({"luminance": np.asfortranarray(np.ones((3, 2, 2), np.float32))}, {}, "ascontiguousarray"),
        ({"luminance": np.ones((3, 1, 70000), np.float16)}, {}, "70000x1, the most is 65536"),
        ({"t": np.arange(3) * 0.1}, {}, r"t is float64.* seconds become that by np\.rint\(1e9 \* t\)\.astype"),
        ({"t": np.arange(4)}, {}, r"t is int64 \[4\], must be int64 \[3\]"),
        ({"t": np.array([0, 5, 4])}, {}, "frame 2 is at 4 ns after 5 ns"),
        ({"t": np.array([0, 5, 5])}, {}, "must go up"),
        ({"t": np.array([0, 1, 2**63], np.uint64)}, {}, "more than int64"),
        ({}, {"colour": True}, "no array rgb"),
        ({"rgb": np.ones((3, 2, 2, 4), np.float32)}, {"colour": True}, r"\[T, H, W, 3\]"),
        ({"dlog_dt": np.ones((3, 2, 1), np.float32)}, {"slopes": True}, r"dlog_dt is float32 \[3, 2, 1\]"),
        ({}, {"tone": "srgb"}, "is linear; a tone curve"),
        ({}, {"tone": "rec"}, "must be srgb, linear, gamma:G, pq or hlg"),
        ({}, {"tone": "gamma:x"}, "after gamma: comes a number"),
        ({}, {"white": -1.0}, "white is -1"),
        ({}, {"fps": 0.0}, "fps is 0"),
        ({}, {"fps": float("nan")}, "fps is nan"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(change, options, text, tmp_path):
    """One error for each, before any frame is given."""
    arrays = {name: array for name, array in (GOOD | change).items() if array is not None}
    np.savez(tmp_path / "f.npz", **arrays)
    with pytest.raises(ValueError, match=text):
        open_frames(tmp_path / "f.npz", FrameOptions(**options))


def test_any_cut_is_an_error(tmp_path):
    """An archive cut anywhere: the table at its end is missing."""
    np.savez(tmp_path / "f.npz", **GOOD)
    data = (tmp_path / "f.npz").read_bytes()
    for n in range(1, len(data)):
        (tmp_path / "c.npz").write_bytes(data[:n])
        with pytest.raises(FramesError, match=r"c\.npz"):
            open_frames(tmp_path / "c.npz")
    (tmp_path / "c.npz").write_bytes(b"")
    with pytest.raises(FramesError, match="is empty"):
        open_frames(tmp_path / "c.npz")


def test_damage_in_the_middle_comes_after_the_good_blocks(tmp_path):
    """Wrong bytes in deflated data: whole blocks before them, then one error, at the latest from the checksum."""
    rng = np.random.default_rng(3)
    luminance = rng.random((100, 200, 200)).astype(np.float32)
    np.savez_compressed(tmp_path / "f.npz", luminance=luminance, t=np.arange(100))
    data = bytearray((tmp_path / "f.npz").read_bytes())
    middle = len(data) // 2
    data[middle : middle + 64] = bytes(64)
    (tmp_path / "f.npz").write_bytes(data)
    seen = []
    with open_frames(tmp_path / "f.npz") as source, pytest.raises(FramesError, match="luminance is damaged"):
        for block in source.blocks():
            seen.append(block.image)
    assert sum(map(len, seen)) < 100
    np.testing.assert_array_equal(np.concatenate(seen)[:25], luminance[:25])


def test_headers_that_lie(tmp_path):
    """A shape larger than the data, also by far: cut short, nothing allocated."""
    for shape, text in (((6, 2, 2), "cut short at entry 3 of 6"), ((1 << 40, 2, 2), r"t is int64 \[3\]")):
        with zipfile.ZipFile(tmp_path / "f.npz", "w") as archive:
            with archive.open("luminance.npy", "w") as out:
                np.lib.format.write_array_header_1_0(out, {"descr": "<f4", "fortran_order": False, "shape": shape})
                out.write(bytes(3 * 2 * 2 * 4))
            with archive.open("t.npy", "w") as out:
                np.lib.format.write_array(out, np.arange(shape[0] if shape[0] < 100 else 3))
        with pytest.raises(FramesError, match=text), open_frames(tmp_path / "f.npz") as source:
            list(source.blocks())


def test_paths(tmp_path):
    """What is not there, and what is no folder of frames."""
    np.savez(tmp_path / "frames.npz", **GOOD)
    with pytest.raises(FramesError, match=r"did you mean 'frames\.npz"):
        open_frames(tmp_path / "frame.npz")
    np.save(tmp_path / "frames.npy", GOOD["luminance"])
    with pytest.raises(FramesError, match=r"frames\.npy: an array alone has no times; save it by np\.savez"):
        open_frames(tmp_path / "frames.npy")
    (tmp_path / "empty").mkdir()
    with pytest.raises(
        FramesError, match=r"no \.exr, \.png, \.jpg, \.tif, \.bmp or \.pgm files in the folder; it has nothing"
    ):
        open_frames(tmp_path / "empty")
    np.savez(tmp_path / "e.npz", t=np.arange(3), x=np.arange(3), y=np.arange(3), p=np.ones(3, int))
    with pytest.raises(FramesError, match="it holds events"):
        open_frames(tmp_path / "e.npz")
