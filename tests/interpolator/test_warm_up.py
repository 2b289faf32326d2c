"""What is warmed before the first keyframe is not made in the first gap, and leaves no trace in the frames."""

import numpy as np
import pytest

from evis.scene.load import load_scene
from nodes.interpolator.interpolator import Interpolator
from nodes.interpolator.keyframe import States
from nodes.interpolator.methods import METHODS, reads
from nodes.interpolator.warm_up import LONGEST
from nodes.renderer.renderer import Renderer

GAP = 8_000_000
MOVING = [name for name in METHODS if name != "none"]


@pytest.fixture(scope="module")
def disk():
    """The scene, and the arguments of three keyframes: stamp, images, states."""
    scene = load_scene("spinning_disk", {"width": 40, "height": 30})
    camera = scene.camera("cam0")
    renderer, keys = Renderer(scene, camera), []
    for k in range(3):
        t = np.linspace(max(k - 1, 0) * GAP, k * GAP, 5 if k else 1).astype(np.int64)
        paths = [body.trajectory for body in scene.bodies]
        pose, twist = (np.stack([getattr(p, n)(t) for p in paths], 1)[None] for n in ("pose", "twist"))
        images = renderer.render(pose[:, -1], pose[:, 0], ("radiance", "depth", "motion"))
        keys.append((k * GAP, [images[n].copy() for n in ("radiance", "depth", "motion")], States(t, pose, twist)))
    return scene, camera, keys


def frames_of(interpolator, keys):
    made = []
    for stamp, images, states in keys:
        _, frames = interpolator.push(stamp, np.zeros(1, np.int32), *images, states=states)
        made.append(np.array(frames))
    return made


def make(name, scene, camera, k=4):
    known = {"scene": scene, "camera": camera} if "state" in reads(name) else {}
    return Interpolator(name, k, **known)


@pytest.mark.parametrize("name", MOVING)
def test_a_long_gap_is_warmed_up_by_a_short_one_and_gives_the_same_frames(disk, name):
    """One as long as this would take longer than what it saves; the method is built all the same."""
    scene, camera, keys = disk
    expected = frames_of(make(name, scene, camera, LONGEST + 1), keys)
    warmed = make(name, scene, camera, LONGEST + 1)
    warmed.warm_up_for(1, camera.height, camera.width)
    for one, other in zip(frames_of(warmed, keys), expected, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("name", MOVING)
def test_the_first_gap_after_a_warm_up_builds_nothing_and_gives_the_same_frames(disk, name, monkeypatch):
    scene, camera, keys = disk
    expected = frames_of(make(name, scene, camera), keys)
    warmed = make(name, scene, camera)
    warmed.warm_up_for(1, camera.height, camera.width)

    def refuse(*size):
        raise AssertionError(f"a method for {size} was built in a gap")

    monkeypatch.setattr(warmed, "_build", refuse)
    for one, other in zip(frames_of(warmed, keys), expected, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("name", ["splat", "splat-quadratic"])
def test_a_warm_up_for_another_size_was_in_vain_but_does_no_harm(disk, name):
    scene, camera, keys = disk
    expected = frames_of(make(name, scene, camera), keys)
    warmed = make(name, scene, camera)
    warmed.warm_up_for(2, 12, 14, 1)
    for one, other in zip(frames_of(warmed, keys), expected, strict=True):
        np.testing.assert_array_equal(one, other)


def test_after_the_first_keyframe_another_size_is_an_error_still(disk):
    scene, camera, keys = disk
    warmed = make("splat", scene, camera)
    warmed.warm_up_for(1, 12, 14)
    frames_of(warmed, keys)
    radiance, depth, motion = (image[:, :-2] for image in keys[0][1])
    with pytest.raises(ValueError, match=r"keyframe is .* before it was"):
        warmed.push(9 * GAP, np.zeros(1, np.int32), radiance, depth, motion)
