"""Frames in folders of EXR and PNG: values, order, times, and what is wrong with a folder."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest

from evis.media.frames.open import open_frames
from evis.media.frames.source import FrameOptions, FramesError
from evis.media.frames.tone import Tone

REC709 = np.array([0.2126, 0.7152, 0.0722])
COLOUR_TYPES = {(2, 1): 0, (3, 3): 2, (3, 4): 6}


def write_png(path, image):
    """8 or 16 bit, grey, RGB or RGBA, by the PNG specification (W3C, third edition): no filter, one IDAT."""
    height, width = image.shape[:2]
    channels = 1 if image.ndim == 2 else image.shape[2]
    head = struct.pack(
        ">IIBBBBB", width, height, 8 * image.itemsize, COLOUR_TYPES[(image.ndim, channels)], 0, 0, 0
    )  # fmt: skip
    rows = image.astype(image.dtype.newbyteorder(">")).reshape(height, -1)
    data = b"".join(b"\0" + row.tobytes() for row in rows)

    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(data)) + chunk(b"IEND", b"")
    )


def write_exr(path, pixels, stamp=None, key=None, **more):
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **more}
    if stamp is not None:
        header[key or "evis/stamp_ns"] = stamp if isinstance(stamp, float) else str(stamp)
    with OpenEXR.File(header, {"RGB" if pixels.ndim == 3 else "Y": np.ascontiguousarray(pixels)}) as file:
        file.write(str(path))


def srgb(code):
    """IEC 61966-2-1, written out for one number."""
    return code / 12.92 if code <= 0.04045 else ((code + 0.055) / 1.055) ** 2.4


def frames_of(path, **options):
    with open_frames(path, FrameOptions(**options)) as source:
        blocks = list(source.blocks())
    return np.concatenate([b.t for b in blocks]), np.concatenate([b.image for b in blocks])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_png_values(dtype, channels, tmp_path):
    """Every depth and colour type, to the last bit of the code, against curves in float64."""
    rng = np.random.default_rng(4)
    most = np.iinfo(dtype).max
    shape = (5, 7) if channels == 1 else (5, 7, channels)
    images = rng.integers(0, most + 1, (3, *shape)).astype(dtype)
    for i, image in enumerate(images):
        write_png(tmp_path / f"{i}.png", image)
    codes = images[..., :3] / most if channels > 1 else np.repeat(images[..., None] / most, 3, axis=3)
    for tone, curve in (("srgb", np.vectorize(srgb)), ("linear", lambda c: c), ("gamma:2.2", lambda c: c**2.2)):
        radiance = 80 * curve(codes)
        t, luminance = frames_of(tmp_path, fps=250, tone=tone, white=80)
        assert t.tolist() == [0, 4_000_000, 8_000_000]
        # float32, of 80: three roundings
        np.testing.assert_allclose(luminance, radiance @ REC709, rtol=4e-7, atol=1e-12)
        rgb = frames_of(tmp_path, fps=250, tone=tone, white=80, colour=True)[1]
        np.testing.assert_allclose(rgb, radiance, rtol=4e-7, atol=1e-12)


@pytest.mark.parametrize(("largest", "bits"), [(255, 8), (1023, 10), (4095, 12), (65535, 16)])
def test_white_of_a_pgm_is_its_largest_code(largest, bits, tmp_path):
    """By the PGM specification of Netpbm: of two bytes, the high one first, where that is above 255."""
    codes = np.array([[0, 1, largest // 3], [largest // 2, largest - 1, largest]])
    for i in range(2):
        head = b"P5\n# of a camera\n3 2\n%d\n" % largest
        (tmp_path / f"{i}.pgm").write_bytes(head + codes.astype(">u2" if largest > 255 else np.uint8).tobytes())
    with open_frames(tmp_path, FrameOptions(fps=10, tone="linear")) as source:
        (block,) = source.blocks()
    assert source.about["bits"] == bits
    np.testing.assert_allclose(block.image, [codes / largest] * 2, rtol=0, atol=0.5 / 65535)


def test_bmp_values(tmp_path):
    """24 bits a pixel by its header: rows from below, blue first, padded to four bytes."""
    image = np.random.default_rng(5).integers(0, 256, (5, 7, 3)).astype(np.uint8)
    rows = b"".join(row.tobytes() + b"\0" * 3 for row in image[::-1, :, ::-1])
    head = struct.pack("<2sIIIIiiHHIIiiII", b"BM", 54 + len(rows), 0, 54, 40, 7, 5, 1, 24, 0, len(rows), 0, 0, 0, 0)
    for i in range(2):
        (tmp_path / f"{i}.bmp").write_bytes(head + rows)
    np.testing.assert_allclose(frames_of(tmp_path, fps=1, tone="linear", colour=True)[1][1], image / 255, rtol=1e-6)


def test_palette_and_bilevel_png(tmp_path):
    """As Pillow writes them."""
    from PIL import Image

    image = np.array([[0, 255], [255, 0]], np.uint8)
    Image.fromarray(image).convert("1").save(tmp_path / "0.png")
    Image.fromarray(np.stack([image, 255 - image, image], 2)).quantize(2).save(tmp_path / "1.png")
    _, luminance = frames_of(tmp_path, fps=1, tone="linear")
    np.testing.assert_allclose(luminance[0], image / 255)
    np.testing.assert_allclose(luminance[1], np.where(image, 0.2848, 0.7152), rtol=1e-6)


def test_srgb_is_its_own_inverse_and_ends_at_white():
    """The forward curve of the standard brings every code back."""
    radiance = Tone("srgb", 3.0).radiance(np.arange(256, dtype=np.uint8)).astype(float) / 3
    code = np.where(radiance <= 0.0031308, radiance * 12.92, 1.055 * radiance ** (1 / 2.4) - 0.055)
    np.testing.assert_array_equal(np.round(code * 255), np.arange(256))
    assert radiance[255] == 1


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_exr_values_and_stamps(dtype, tmp_path):
    """Half and float, RGB and Y; the time of either attribute."""
    rng = np.random.default_rng(5)
    rgb = (rng.random((4, 6, 8, 3)) * 1000).astype(dtype)
    stamps = [7, 1_000_000_007, 2_000_000_000, 2**62]
    for i, image in enumerate(rgb):
        write_exr(tmp_path / f"{i}.exr", image, stamps[i], "evis/time_ns" if i == 2 else None)
    t, luminance = frames_of(tmp_path)
    assert t.tolist() == stamps
    np.testing.assert_allclose(luminance, rgb.astype(float) @ REC709, rtol=4e-7)
    np.testing.assert_array_equal(frames_of(tmp_path, colour=True)[1], rgb.astype(np.float32))
    (tmp_path / "y").mkdir()
    write_exr(tmp_path / "y" / "a.exr", rgb[0, :, :, 0])
    np.testing.assert_array_equal(frames_of(tmp_path / "y", fps=1)[1][0], rgb[0, :, :, 0].astype(np.float32))


def test_order_and_times(tmp_path):
    """Numbers count by value; times.txt decides otherwise; --fps decides over it."""
    for i in range(12):
        write_png(tmp_path / f"f{i}.png", np.full((2, 2), i, np.uint8))

    def codes(**options):
        t, luminance = frames_of(tmp_path, tone="linear", white=255, **options)
        return t.tolist(), luminance[:, 0, 0].round().astype(int).tolist()

    with pytest.raises(FramesError, match=r"f0\.png: no time; give --fps, or a times\.txt"):
        codes()
    assert codes(fps=1000) == ([i * 1_000_000 for i in range(12)], list(range(12)))
    (tmp_path / "times.txt").write_text("# name t_ns\nf7.png -5\n\nf2.png\t0\nf10.png, 123456789012345678\n")
    assert codes() == ([-5, 0, 123456789012345678], [7, 2, 10])
    assert codes(fps=1)[1] == list(range(12))
    with open_frames(tmp_path, FrameOptions()) as source:
        assert source.about["files_left_out"] == 9 and source.count == 3


def test_names_with_digits_that_are_no_numbers(tmp_path):
    """A superscript is a digit to Unicode, and no number to Python."""
    for i, name in enumerate(("1²2.png", "1²10.png", "2.png", "10.png")):
        write_png(tmp_path / name, np.full((2, 2), i, np.uint8))
    _, luminance = frames_of(tmp_path, tone="linear", white=255, fps=10)
    assert luminance[:, 0, 0].round().astype(int).tolist() == [0, 1, 2, 3]


def test_times_that_begin_with_a_byte_order_mark(tmp_path):
    """As editors of Windows save UTF-8."""
    for name in ("a.png", "b.png"):
        write_png(tmp_path / name, np.zeros((2, 3), np.uint8))
    (tmp_path / "times.txt").write_bytes(b"\xef\xbb\xbfa.png 5\r\nb.png 9\r\n")
    t, _ = frames_of(tmp_path)
    assert t.tolist() == [5, 9]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("f0.png 5\nf1.png 5\n", r"times\.txt:2: f1\.png is at 5 ns, not after 5 ns"),
        ("f0.png 5\nf9.png 6\n", r"times\.txt:2: there is no file 'f9\.png'"),
        ("f0.png 0.5\n", r"times\.txt:1: 'f0\.png 0\.5' must be a file name and its time in whole ns"),
        ("f0.png\n", "must be a file name"),
        ("# nothing\n", "names no files"),
        ("f0.png 99999999999999999999\n", "must be a file name"),
        ("f0.png 9999999999999999999\n", "does not fit int64"),
    ],
)
def test_bad_times(text, message, tmp_path):
    """The line is named."""
    for i in range(2):
        write_png(tmp_path / f"f{i}.png", np.zeros((2, 2), np.uint8))
    (tmp_path / "times.txt").write_text(text)
    with pytest.raises(FramesError, match=message):
        frames_of(tmp_path)


def test_a_bad_frame_comes_after_the_good_ones(tmp_path):
    """Another size, a cut file, no image at all: the frames before it are given first, and the file is named."""
    good = np.full((40, 50), 9, np.uint8)
    for i in range(5):
        write_png(tmp_path / f"{i}.png", good)
    write_png(tmp_path / "4.png", np.random.default_rng(8).integers(0, 256, (40, 50)).astype(np.uint8))
    whole = (tmp_path / "4.png").read_bytes()
    cases = {
        r"4\.png: cannot be read as PNG": [whole[:n] for n in (0, 7, 20, 45, len(whole) // 2)] + [b"\x89PNG\r\n" * 9],
        r"4\.png: 6x5, the frames before are 50x40": [None],
    }
    for text, contents in cases.items():
        for content in contents:
            if content is None:
                write_png(tmp_path / "4.png", np.zeros((5, 6), np.uint8))
            else:
                (tmp_path / "4.png").write_bytes(content)
            with open_frames(tmp_path, FrameOptions(fps=10)) as source:
                blocks = source.blocks()
                assert next(blocks).t.tolist() == [0, 100_000_000, 200_000_000, 300_000_000]
                with pytest.raises(FramesError, match=text):
                    next(blocks)


def test_exr_frames_that_are_stored_in_part(tmp_path):
    """A compositor stores the box that is not black, another in each frame: all are as large as what is shown."""
    draw = np.random.default_rng(4)
    frames = np.zeros((3, 6, 9), np.float32)
    for i, (top, left, bottom, right) in enumerate([(1, 2, 4, 8), (0, 0, 6, 9), (2, 5, 3, 6)]):
        frames[i, top:bottom, left:right] = draw.uniform(0.1, 3, (bottom - top, right - left))
        # The origin of the display window is anywhere.
        first, last = np.array([left - 7, top + 20], "i4"), np.array([right - 8, bottom + 19], "i4")
        shown = np.array([-7, 20], "i4"), np.array([1, 25], "i4")
        part = frames[i, top:bottom, left:right]
        write_exr(tmp_path / f"{i}.exr", part, i, dataWindow=(first, last), displayWindow=shown)
    assert np.array_equal(frames_of(tmp_path)[1], frames)


def test_bad_exr(tmp_path):
    """Cut anywhere, stamps that do not ascend or are no numbers, channels that are no light."""
    image = np.random.default_rng(6).random((20, 30, 3)).astype(np.float32)
    for i in range(3):
        write_exr(tmp_path / f"{i}.exr", image, i)
    whole = (tmp_path / "2.exr").read_bytes()
    for n in (0, 3, 50, 200, len(whole) // 2, len(whole) - 9):
        (tmp_path / "2.exr").write_bytes(whole[:n])
        with open_frames(tmp_path) as source:
            blocks = source.blocks()
            assert len(next(blocks).t) == 2
            with pytest.raises(FramesError, match=r"2\.exr: "):
                next(blocks)
    for stamp, text in (
        (1, "1 ns does not come after 1 ns of .*; --fps"),
        ("soon", "must be whole nanoseconds"),
        (1.75, "attribute is 1.75, must be whole nanoseconds"),
        (float("inf"), "attribute is inf, must be whole nanoseconds"),
    ):
        write_exr(tmp_path / "2.exr", image, stamp)
        with pytest.raises(FramesError, match=text):
            frames_of(tmp_path)
    with pytest.raises(FramesError, match="EXR is linear"):
        open_frames(tmp_path, FrameOptions(tone="srgb"))
    write_png(tmp_path / "3.png", np.zeros((2, 2), np.uint8))
    with pytest.raises(FramesError, match="holds 3 EXR and 1 PNG files"):
        open_frames(tmp_path)


def test_exr_without_light(tmp_path):
    """Depth alone is no frame."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "evis/stamp_ns": "0"}
    with OpenEXR.File(header, {"Z": np.ones((2, 2), np.float32)}) as file:
        file.write(str(tmp_path / "0.exr"))
    with pytest.raises(FramesError, match="no R, G and B, and no Y, of half or float; it has Z"):
        open_frames(tmp_path)
