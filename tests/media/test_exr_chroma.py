"""EXR files with luminance and chroma, written by hand to the format's text: read as the colours that they are of."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from evis.media.exr_chroma import luminance_weights, rgb_of
from evis.media.frames.open import open_frames
from evis.media.frames.source import FrameOptions, FramesError
from evis.scene.images.pictures import load_exr

REC_709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
REC_2020 = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)


def attribute(name: str, kind: str, value: bytes) -> bytes:
    return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value


def write(path: Path, primaries: tuple[float, ...] = (), **channels: np.ndarray) -> None:
    """An uncompressed scan line file of half; a channel of half the size is one of every second pixel and row."""
    height, width = channels["Y"].shape
    halves = {name: array.astype("<f2") for name, array in sorted(channels.items())}
    listed = {name: (array, 1 if len(array) == height else 2) for name, array in halves.items()}
    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    head = b"\x76\x2f\x31\x01\x02\0\0\0"
    kinds = b"".join(n.encode() + b"\0" + struct.pack("<iB3xii", 1, 0, s, s) for n, (_, s) in listed.items()) + b"\0"
    head += attribute("channels", "chlist", kinds) + attribute("compression", "compression", b"\0")
    head += attribute("dataWindow", "box2i", box) + attribute("displayWindow", "box2i", box)
    head += attribute("lineOrder", "lineOrder", b"\0") + attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
    head += attribute("screenWindowCenter", "v2f", bytes(8))
    head += attribute("screenWindowWidth", "float", struct.pack("<f", 1))
    if primaries:
        head += attribute("chromaticities", "chromaticities", struct.pack("<8f", *primaries))
    head += b"\0"
    bodies = [b"".join(a[y // s].tobytes() for a, s in listed.values() if y % s == 0) for y in range(height)]
    lines = [struct.pack("<ii", y, len(body)) + body for y, body in enumerate(bodies)]
    starts = len(head) + 8 * height + np.cumsum([0, *map(len, lines[:-1])])
    path.write_bytes(head + starts.astype("<u8").tobytes() + b"".join(lines))


def encoded(rgb: np.ndarray, primaries: tuple[float, ...], step: int = 2) -> dict[str, np.ndarray]:
    """By the definition; chroma that changes slowly is that of every second pixel as it is."""
    y = rgb @ luminance_weights(primaries)
    return {"Y": y, "RY": ((rgb[..., 0] - y) / y)[::step, ::step], "BY": ((rgb[..., 2] - y) / y)[::step, ::step]}


def slow(height: int = 40, width: int = 60) -> np.ndarray:
    """Colours that change with 30 pixels and more a period, and light that is different at every pixel."""
    v, u = np.mgrid[:height, :width]
    tint = np.stack([1 + 0.4 * np.cos(u / 5), 0.9 + 0 * u, 1 - 0.3 * np.sin(v / 6 + u / 9)], axis=-1)
    return tint * np.random.default_rng(0).uniform(0.1, 5, (height, width, 1))


def test_weights_are_those_of_the_standards() -> None:
    assert np.allclose(luminance_weights(REC_709), [0.2126, 0.7152, 0.0722], atol=6e-5)  # ITU-R BT.709-6, item 3.2
    assert np.allclose(luminance_weights(REC_2020), [0.2627, 0.6780, 0.0593], atol=6e-5)  # ITU-R BT.2020-2, table 4
    with pytest.raises(ValueError, match="span no colours"):
        luminance_weights((0.3, 0.3) * 4)


@pytest.mark.parametrize("primaries", [(), REC_709, REC_2020])
@pytest.mark.parametrize("step", [1, 2])
def test_a_picture_is_what_was_written(primaries: tuple[float, ...], step: int, tmp_path: Path) -> None:
    """Half has 11 bits; between samples the filter is right to some 1e-3, but for 13 pixels at the border."""
    true = slow()
    write(tmp_path / "a.exr", primaries, **encoded(true, primaries or REC_709, step))
    read = load_exr(tmp_path / "a.exr")
    error = np.abs(read / true - 1)
    assert error[14:-14, 14:-14].max() < 0.004 and np.median(error) < 0.001
    assert error.max() < (0.004 if step == 1 else 0.2)


def test_grey_is_grey_and_one_colour_is_that_colour(tmp_path: Path) -> None:
    """To the last bit that half has, also at the border, where the last sample goes on."""
    light = np.random.default_rng(1).uniform(0.1, 5, (6, 10)).astype(np.float16).astype(np.float64)
    write(tmp_path / "grey.exr", Y=light, RY=np.zeros((3, 5)), BY=np.zeros((3, 5)))
    assert np.allclose(load_exr(tmp_path / "grey.exr"), light[..., None], rtol=1e-6)
    write(tmp_path / "one.exr", Y=light, RY=np.full((3, 5), 0.5), BY=np.full((3, 5), -0.25))
    green = (1 - 1.5 * 0.21264 - 0.75 * 0.07219) / 0.71517
    assert np.allclose(load_exr(tmp_path / "one.exr"), light[..., None] * [1.5, green, 0.75], rtol=1e-4)


def test_frames_have_its_colours_and_its_luminance(tmp_path: Path) -> None:
    true = slow()
    for k in range(2):
        write(tmp_path / f"{k}.exr", **encoded((k + 1) * true, REC_709))
    for colour, wanted in ((True, true), (False, true @ [0.2126, 0.7152, 0.0722])):
        with open_frames(tmp_path, FrameOptions(colour=colour, fps=100.0)) as frames:
            images = np.concatenate([block.image for block in frames.blocks()])
        error = np.abs(images / np.stack([wanted, 2 * wanted]) - 1)
        assert error[:, 14:-14, 14:-14].max() < 0.004


def test_nothing_is_below_zero_beside_an_edge_and_its_light_stays() -> None:
    """Chroma overshoots where it jumps, and beside full red green would be less than none."""
    rgb = np.ones((32, 32, 3))
    rgb[:, 16:] = [1.0, 1e-3, 1e-3]
    parts = encoded(rgb, REC_709)
    made = rgb_of(parts["Y"], parts["RY"], parts["BY"], REC_709)
    assert made.min() >= 0
    assert np.allclose(made @ luminance_weights(REC_709), parts["Y"], rtol=1e-3)
    # Six pixels from the edge the filter still swings by 3 % of the jump, and chroma jumps by 3.7 there.
    assert np.abs(made[:, :10] - 1).max() < 0.12 and np.abs(made[:, 22:] - rgb[:, 22:]).max() < 0.12


def test_what_does_not_go_together_is_told(tmp_path: Path) -> None:
    write(tmp_path / "half.exr", Y=np.ones((4, 4)), RY=np.ones((2, 2)))
    with pytest.raises(FramesError, match=r"it has RY \(half\), Y \(half\); Y is read alone, or with both RY and BY"):
        open_frames(tmp_path, FrameOptions(fps=10.0))
    with pytest.raises(ValueError, match="its chroma is 3x3 and its luminance 4x4 pixels"):
        rgb_of(np.ones((4, 4)), np.ones((3, 3)), np.ones((3, 3)), REC_709)
