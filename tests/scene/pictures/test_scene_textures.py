"""Bricks and planks: what is joint, what is face, and that they tile."""

import numpy as np
import pytest

from evis.scene import SceneError, load_scene
from evis.scene.images import textures


def test_bricks_cover_what_their_joints_leave():
    """With joints of a tenth of a row: 0.9 of the height and 0.95 of the length (a brick is two rows long)."""
    image = textures.bricks(512, 8, 0.1, 0.9, 0.1, seed=3)
    assert image.shape == (512, 512) and image.min() >= 0.1 - 1e-5 and image.max() <= 0.9 + 1e-5
    face = image > 0.3  # faces are 0.1 + 0.8 * (0.6 ... 1)
    assert abs(face.mean() - 0.9 * 0.95) < 0.02
    rows = image.reshape(8, 64, 512)
    assert (rows[:, 40].std(axis=1) > 0.02).all(), "every brick has its own value"
    # Joints of the second row stand half a brick from those of the first.
    first, second = (np.flatnonzero(rows[i, 40] < 0.2).mean() % 128 for i in (0, 1))
    assert abs((first - second) % 128 - 64) < 6


def test_planks_run_along_v():
    """Grain changes slowly along the boards and fast across; joints are dark."""
    image = textures.planks(256, 4, 0.0, 1.0, 0.05, seed=3)
    along, across = (np.abs(np.diff(image, axis=a)).mean() for a in (0, 1))
    assert across > 5 * along
    columns = image.mean(axis=0).reshape(4, 64)
    assert (columns[:, :2] < 0.5 * columns[:, 10:].mean(axis=1, keepdims=True)).all()


@pytest.mark.parametrize("make", [textures.bricks, textures.planks])
def test_they_tile_and_repeat(make):
    """No seam: the step over the edge is no larger than the steps inside; the same seed, the same bytes."""
    image = make(256, 8, 0.1, 0.9, 0.1, 5)
    for axis in (0, 1):
        inside = np.abs(np.diff(image, axis=axis)).mean(axis=1 - axis)
        seam = np.abs(np.take(image, 0, axis) - np.take(image, -1, axis)).mean()
        assert seam <= inside.max() * 1.05
    assert make(256, 8, 0.1, 0.9, 0.1, 5).tobytes() == image.tobytes()
    assert np.abs(make(256, 8, 0.1, 0.9, 0.1, 6) - image).mean() > 0.01


def test_an_odd_number_of_rows_does_not_tile(tmp_path):
    """So a scene may not ask for it."""
    path = tmp_path / "s.yaml"
    path.write_text("cameras: {cam0: {fov: 1}}\nmaterials: {m: {texture: {kind: bricks, cells: 7}}}\n")
    with pytest.raises(SceneError, match=r"s\.yaml:2: .*cells is 7; the rows of bricks must be even"):
        load_scene(str(path))


@pytest.mark.parametrize(
    "texture, words",
    [
        ("{kind: checker, size: 64, cells: 65}", "cells is 65; a picture of 64 texels shows 64 squares"),
        ("{kind: checker, size: 4096, cells: 4096}", "cells is 4096; a picture of 4096 texels shows 1024 squares"),
        ("{kind: noise, feature: 2}", "feature is 2; the most is 1"),
        ("{kind: blobs, feature: 100}", "feature is 100; the most is 1"),
    ],
)
def test_patterns_that_a_picture_cannot_show_are_refused(tmp_path, texture, words):
    """Squares smaller than texels were grey, or all of one value; noise as wide as its picture was NaN or even."""
    path = tmp_path / "s.yaml"
    path.write_text(f"cameras: {{cam0: {{fov: 1}}}}\nmaterials: {{m: {{texture: {texture}}}}}\n")
    with pytest.raises(SceneError, match=rf"s\.yaml:2: .*{words}"):
        load_scene(str(path))


def test_the_most_that_a_picture_can_show(tmp_path):
    """Squares of one texel alternate; noise as wide as its picture has one wave a side, by its spectrum."""
    path = tmp_path / "s.yaml"
    materials = "a: {texture: {kind: checker, size: 64, cells: 64}}, b: {texture: {kind: noise, size: 64, feature: 1}}"
    path.write_text(f"cameras: {{cam0: {{fov: 1}}}}\nmaterials: {{{materials}}}\n")
    squares, noise = (material.texture[..., 0] for material in load_scene(str(path)).materials)
    odd = np.add.outer(np.arange(64), np.arange(64)) % 2 == 1
    assert squares[odd].min() > squares[~odd].max() + 0.1
    power = np.abs(np.fft.fft2(noise - noise.mean())) ** 2
    assert power[[0, 0, 1, -1], [1, -1, 0, 0]].sum() > 0.98 * power.sum()


@pytest.mark.parametrize("mode, told", [("RGB", 0), ("opaque", 0), ("RGBA", 1), ("LA", 1), ("P", 1)])
def test_a_transparent_picture_is_told(tmp_path, mode, told):
    """A hole in the middle, as an alpha channel or as an entry of the palette; an alpha of 255 throughout is none."""
    from PIL import Image

    if mode == "P":
        picture = Image.new("P", (8, 8), 1)
        picture.putpalette([0, 0, 0, 200, 100, 50])
        picture.putpixel((4, 4), 0)
        picture.save(tmp_path / "leaf.png", transparency=0)
    else:
        picture = Image.new("RGBA" if mode == "opaque" else mode, (8, 8))
        hole = 255 if mode == "opaque" else 0
        rest = (9,) * (len(picture.getbands()) - 1)
        picture.putdata([(*rest, hole if k == 20 else 255) for k in range(64)])
        picture.save(tmp_path / "leaf.png")
    (tmp_path / "s.yaml").write_text(
        "cameras: {cam0: {fov: 1}}\nenvironment: 1\nmaterials: {leaf: {texture: {kind: image, file: leaf.png}}}\n"
        "world: [{shape: plane, size: [1, 1], material: leaf}]\n"
    )
    lines = load_scene(str(tmp_path / "s.yaml")).left_out
    assert len(lines) == told and all(
        "leaf.png has transparent texels, which are drawn opaque" in line for line in lines
    )
