"""Parts of sequences of frames: crop, size and time against arrays cut by hand; JPEG, TIFF and patterns."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from PIL import Image
from scipy.integrate import quad

from evis.media.frames.ends import BLACK, FULL, ends_of
from evis.media.frames.open import open_frames
from evis.media.frames.resize import Resize
from evis.media.frames.selection import SelectedFrames, Selection
from evis.media.frames.source import BLOCK_FRAMES, FrameOptions, FramesError

RNG = np.random.default_rng(3)


def frames_of(source):
    with source:
        blocks = list(source.blocks())
    return np.concatenate([b.t for b in blocks]), np.concatenate([b.image for b in blocks])


@pytest.fixture
def archive(tmp_path):
    """300 frames of 20x14 every 10 ms, from 5 ns on."""
    images = RNG.random((300, 14, 20), np.float32)
    t = 5 + np.arange(300) * 10_000_000
    np.savez(tmp_path / "f.npz", luminance=images, t=t)
    return tmp_path / "f.npz", images, t


def test_crop_and_time_are_exact(archive):
    """The same numbers as slicing: the start is included, the end is not; times stay, or are divided."""
    path, images, t = archive
    chosen = Selection(crop=(3, 2, 10, 7), start_ns=400_000_000, stop_ns=2_000_000_000)
    stamps, got = frames_of(SelectedFrames(open_frames(path), chosen))
    np.testing.assert_array_equal(stamps, t[40:200])
    np.testing.assert_array_equal(got, images[40:200, 2:9, 3:13])
    stamps, got = frames_of(SelectedFrames(open_frames(path), Selection(slow_motion=2.5)))
    assert stamps.tolist() == [round(Fraction(int(s)) / Fraction(5, 2)) for s in t]
    np.testing.assert_array_equal(got, images)


def test_time_is_that_of_the_source_under_slow_motion(archive):
    """--from and --to are seconds as the source plays."""
    path, _, t = archive
    chosen = Selection(start_ns=1_000_000_000, stop_ns=1_500_000_000, slow_motion=10.0)
    stamps, _ = frames_of(SelectedFrames(open_frames(path), chosen))
    np.testing.assert_allclose(stamps, t[100:150] / 10, atol=0.51)


@pytest.mark.parametrize("place", [1, BLOCK_FRAMES])
def test_frames_that_slow_motion_brings_to_one_time_are_refused(place, tmp_path):
    """Within a block, and where one begins."""
    t = np.arange(BLOCK_FRAMES + 5) * 8
    t[place:] -= 7
    np.savez(tmp_path / "f.npz", luminance=np.ones((len(t), 2, 3), np.float32), t=t)
    with pytest.raises(FramesError, match="slow-motion 8 leaves frames less than 1 ns apart"):
        frames_of(SelectedFrames(open_frames(tmp_path / "f.npz"), Selection(slow_motion=8.0)))


def test_slopes_are_faster_in_slow_motion(tmp_path):
    """d ln I/dt is per second of the scene."""
    images, slopes = np.ones((4, 3, 5), np.float32), RNG.random((4, 3, 5), np.float32)
    np.savez(tmp_path / "f.npz", luminance=images, dlog_dt=slopes, t=np.arange(4) * 1000)
    with open_frames(tmp_path / "f.npz", FrameOptions(slopes=True)) as source:
        block = next(iter(SelectedFrames(source, Selection(crop=(1, 0, 3, 2), slow_motion=4.0)).blocks()))
        np.testing.assert_array_equal(block.dlog_dt, slopes[:, :2, 1:4] * 4)
        with pytest.raises(FramesError, match="dlog_dt cannot be resized"):
            SelectedFrames(source, Selection(width=2))


@pytest.mark.parametrize("after", [(5, 7), (13, 4), (1, 1), (6, 30)])
def test_size_against_integrals(after):
    """Shrinking is the mean of the picture, constant over each pixel, over the new pixel's area; by quadrature."""
    image = RNG.random((13, 9)).astype(np.float32)
    got = Resize((13, 9), after)(image[None])[0]

    def along(line, m):
        n = len(line)
        if m >= n:
            return np.interp((np.arange(m) + 0.5) * n / m - 0.5, np.arange(n), line)
        value = lambda x: line[min(int(x), n - 1)]
        edges = np.arange(m + 1) * n / m
        inside = lambda a, b: [x for x in range(1, n) if a < x < b] or None
        return [quad(value, a, b, points=inside(a, b))[0] / (b - a) for a, b in pairwise(edges)]

    expected = np.array([along(column, after[0]) for column in image.T.astype(float)]).T
    expected = np.array([along(row, after[1]) for row in expected])
    np.testing.assert_allclose(got, expected, rtol=1e-5)


def test_a_bad_pixel_spoils_no_other_than_those_it_is_part_of():
    """Of 300 pixels in 150, pixel 4 is in the third alone; of 77 in 11, of 7 each, pixel 70 is in the last."""
    for n, m, at in ((300, 150, 4), (298, 149, 4), (77, 11, 70), (3, 9, 1)):
        for bad in (np.inf, np.nan):
            line = np.ones(n, np.float32)
            line[at] = bad
            got = Resize((1, n), (1, m))(line[None, None])[0, 0]
            # enlarged, a pixel reaches to the centres of its neighbours and not up to them
            centre = (np.arange(m) + 0.5) * n / m - 0.5
            want = np.abs(centre - at) < 1 - 1e-9 if m > n else np.arange(m) == at * m // n
            assert (np.isfinite(got) == ~want).all()


def test_size_keeps_proportions_from_one_side(archive):
    path, _, _ = archive
    for given, size in (({"width": 10}, (10, 7)), ({"height": 7}, (10, 7)), ({"width": 40, "height": 10}, (40, 10))):
        with SelectedFrames(open_frames(path), Selection(**given)) as source:
            assert (source.width, source.height) == size
            assert next(iter(source.blocks())).image.shape[1:] == size[::-1]
            assert source.stretched == (2.8 if size[0] == 40 else 1)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"crop": (15, 0, 6, 4)}, "crop 15,0,6,4 is not inside the frames of 20x14"),
        ({"crop": (0, 0, 0, 4)}, "is not inside"),
        ({"start_ns": 2_000_000_000, "stop_ns": 1_000_000_000}, "from 2 to 1 s: the end must be later"),
        ({"start_ns": 9_000_000_000}, "from 9 s: the source has no frame then"),
        ({"slow_motion": 0.0}, "slow-motion is 0"),
        ({"slow_motion": -2.0}, "slow-motion is -2"),
        ({"slow_motion": float("nan")}, "slow-motion is nan"),
        ({"width": 0}, "width is 0"),
        ({"start_ns": -1}, "0 or more"),
    ],
)
def test_bad_parts(given, text, archive):
    with pytest.raises(FramesError, match=text):
        frames_of(SelectedFrames(open_frames(archive[0]), Selection(**given)))


def srgb(code):
    """IEC 61966-2-1."""
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("compression", [None, "tiff_lzw", "tiff_deflate"])
def test_tiff_values(compression, tmp_path):
    """8 bit as Pillow writes it, 16 bit grey too."""
    grey = RNG.integers(0, 65536, (5, 7)).astype(np.uint16)
    Image.fromarray(grey).save(tmp_path / "0.tif", compression=compression)
    luminance = frames_of(open_frames(tmp_path, FrameOptions(fps=1, tone="linear", white=65535)))[1]
    np.testing.assert_allclose(luminance[0], grey, rtol=2e-7)
    rgb = RNG.integers(0, 256, (5, 7, 3)).astype(np.uint8)
    (tmp_path / "c").mkdir()
    Image.fromarray(rgb).save(tmp_path / "c" / "0.tiff", compression=compression)
    luminance = frames_of(open_frames(tmp_path / "c", FrameOptions(fps=1)))[1]
    np.testing.assert_allclose(luminance[0], srgb(rgb / 255) @ [0.2126, 0.7152, 0.0722], rtol=4e-7)


@pytest.mark.parametrize("order", ["<", ">"])
def test_tiff_of_16_bit_colour(order, tmp_path):
    """Written byte by byte after the TIFF 6.0 specification, in both orders of bytes; Pillow does not write it."""
    import struct

    rgb = RNG.integers(0, 65536, (4, 6, 3)).astype(np.uint16)
    data = rgb.astype(order + "u2").tobytes()
    tags = [(256, 3, 6), (257, 3, 4), (258, 3, -1), (259, 3, 1), (262, 3, 2), (273, 4, 8), (277, 3, 3), (278, 3, 4)]
    tags.append((279, 4, len(data)))
    bits = 8 + len(data)
    out = (b"II" if order == "<" else b"MM") + struct.pack(order + "HI", 42, bits + 6) + data
    out += struct.pack(order + "3H", 16, 16, 16) + struct.pack(order + "H", len(tags))
    for tag, kind, value in tags:
        count, place = (3, struct.pack(order + "I", bits)) if tag == 258 else (1, b"")
        place = place or (struct.pack(order + "HH", value, 0) if kind == 3 else struct.pack(order + "I", value))
        out += struct.pack(order + "HHI", tag, kind, count) + place
    (tmp_path / "0.tif").write_bytes(out + struct.pack(order + "I", 0))
    got = frames_of(open_frames(tmp_path, FrameOptions(fps=1, tone="linear", white=65535, colour=True)))[1]
    np.testing.assert_allclose(got[0], rgb, rtol=2e-7)


def test_jpeg_and_patterns(tmp_path):
    """The order is that of the numbers, across folders; other kinds beside it do not matter to a pattern."""
    for name, code in (("a/f2.jpg", 20), ("a/f10.jpg", 100), ("b/f1.jpg", 200)):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        Image.new("L", (16, 8), code).save(tmp_path / name, quality=100)
    Image.new("L", (16, 8)).save(tmp_path / "a" / "mask.png")
    options = FrameOptions(fps=10, tone="linear", white=255)
    with pytest.raises(FramesError, match="holds 2 JPEG and 1 PNG files; keep one kind in the folder, or give a patt"):
        open_frames(tmp_path / "a", options)
    t, luminance = frames_of(open_frames(tmp_path / "*" / "f*.jpg", options))
    assert t.tolist() == [0, 100_000_000, 200_000_000]
    np.testing.assert_allclose(luminance[:, 0, 0], [20, 100, 200], rtol=1e-6)
    with open_frames(tmp_path / "a" / "f*.jpg", options) as source:
        assert source.kind == "jpeg" and source.count == 2 and source.about["bits"] == 8
    with pytest.raises(FramesError, match="no file matches the pattern"):
        open_frames(tmp_path / "a" / "g*.jpg", options)


@pytest.mark.parametrize("form", ["tif", "jpg"])
def test_an_unreadable_image_is_named(form, tmp_path):
    Image.fromarray(RNG.integers(0, 256, (40, 50)).astype(np.uint8)).save(tmp_path / f"0.{form}")
    whole = (tmp_path / f"0.{form}").read_bytes()
    for content in (b"no image", whole[:40], whole[: len(whole) // 2]):
        (tmp_path / f"1.{form}").write_bytes(content)
        with pytest.raises(FramesError, match=rf"1\.{form}: cannot be read as"):
            frames_of(open_frames(tmp_path, FrameOptions(fps=1)))


@pytest.mark.parametrize("form", ["jpg", "tif"])
@pytest.mark.parametrize("orientation, corner", [(1, (0, 0)), (3, (-1, -1)), (6, (0, -1)), (8, (-1, 0))])
def test_a_picture_is_turned_as_it_is_looked_at(orientation, corner, form, tmp_path):
    """Exif 2.32, 4.6.4: orientation 6 says that the first row is the right side, and the first column the top."""
    codes = np.zeros((32, 64), np.uint8)
    codes[:16, :16] = 255
    exif = Image.Exif()
    exif[0x0112] = orientation
    Image.fromarray(codes).save(tmp_path / f"f0.{form}", exif=exif)
    with open_frames(tmp_path, FrameOptions(fps=10)) as source:
        _, image = frames_of(source)
    assert image.shape == ((1, 64, 32) if orientation > 4 else (1, 32, 64))
    assert [at for at in ((0, 0), (0, -1), (-1, 0), (-1, -1)) if image[(0, *at)] > 0.8] == [corner]


def test_an_image_with_the_ending_of_another_format_is_told(tmp_path):
    """A JPEG that is called f0.png, without the address of some bytes in memory."""
    Image.fromarray(np.zeros((8, 8), np.uint8)).save(tmp_path / "f0.png", "JPEG")
    with pytest.raises(FramesError, match=r"f0\.png: .* does not begin as PNG does: .* of another format$"):
        open_frames(tmp_path, FrameOptions(fps=10))


@pytest.mark.parametrize("pixels", [[0, 70_000], [-3, 300]])
def test_whole_numbers_beyond_16_bits_are_refused(pixels, tmp_path):
    """A TIFF of int32, which microscopes and scientific cameras write."""
    Image.fromarray(np.array([pixels], np.int32)).save(tmp_path / "f0.tif")
    with pytest.raises(FramesError, match=rf"f0\.tif: .* pixels are {pixels[0]} to {pixels[1]}, beyond 16 bits; write"):
        open_frames(tmp_path, FrameOptions(fps=10))


def test_many_pages_are_refused(tmp_path):
    Image.new("L", (4, 4)).save(tmp_path / "0.tif", save_all=True, append_images=[Image.new("L", (4, 4), 9)])
    with pytest.raises(FramesError, match="it holds 2 pages; write each to a file of its own"):
        open_frames(tmp_path, FrameOptions(fps=1))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_ends_of_codes(dtype):
    """Full scale is any channel at its largest code, black is all of them at 0."""
    most = np.iinfo(dtype).max
    codes = np.array([[[0, 0, 0], [0, 0, 1], [most, 0, 0], [most - 1, 7, 0], [most, most, most]]], dtype)
    assert ends_of(codes)[0].tolist() == [BLACK, 0, FULL, 0, FULL]
    assert ends_of(codes[..., 0])[0].tolist() == [BLACK, BLACK, FULL, 0, FULL]
