"""Which channels of an EXR file are its picture, as OpenEXR writes them."""

import numpy as np
import OpenEXR
import pytest

from evis.media.frames.exr import ExrFrames
from evis.media.frames.source import FrameOptions, FramesError
from evis.scene import SceneError
from evis.scene.images.pictures import load_exr

FLOAT, HALF = (np.full((4, 5), 0.5, kind) for kind in (np.float32, np.float16))
WHOLE = np.ones((4, 5), np.uint32)


def write(path, **channels):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {name.replace("_", "."): pixels for name, pixels in channels.items()}) as file:
        file.write(str(path))


@pytest.mark.parametrize(
    "channels",
    [
        {"R": FLOAT, "G": HALF, "B": HALF, "A": FLOAT},
        {"R": WHOLE, "G": WHOLE, "B": WHOLE, "Y": HALF},
        {"Y": FLOAT, "Z": WHOLE},
    ],
)
def test_a_picture_is_found_whatever_stands_beside_it(tmp_path, channels):
    """Kinds that differ among R, G and B, which OpenEXR does not join; grey beside numbers."""
    for k in range(2):
        write(tmp_path / f"{k}.exr", **channels)
    assert (load_exr(tmp_path / "0.exr") == 0.5).all()
    frames = ExrFrames(tmp_path, ["0.exr", "1.exr"], FrameOptions(fps=10.0))
    assert all(np.allclose(block.image, 0.5) for block in frames.blocks())


@pytest.mark.parametrize(
    "channels, words",
    [
        ({"R": WHOLE, "G": WHOLE, "B": WHOLE}, "it has B (uint), G (uint), R (uint)"),
        ({"R": FLOAT, "G": HALF}, "it has G (half), R (float)"),
        ({"a_R": FLOAT, "a_G": FLOAT, "a_B": FLOAT}, "a.R (float); layers are not read"),
    ],
)
def test_what_there_is_instead_is_told(tmp_path, channels, words):
    write(tmp_path / "0.exr", **channels)
    with pytest.raises(SceneError) as caught:
        load_exr(tmp_path / "0.exr")
    assert "has no R, G and B, and no Y, of half or float; " in str(caught.value) and words in str(caught.value)
    with pytest.raises(FramesError) as caught:
        next(ExrFrames(tmp_path, ["0.exr"], FrameOptions(fps=10.0)).blocks())
    assert words in str(caught.value)
