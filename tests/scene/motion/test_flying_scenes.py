"""flying_shapes and balls: motion in closed form without a jump, worlds by the seed, as many bodies as asked for."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from evis.scene import load_scene
from evis.scene.digest import appearance, motion

NAMES = ("flying_shapes", "balls")
COUNT = {"flying_shapes": ("shapes", "flyer"), "balls": ("balls", "ball")}
MS = 1_000_000


def bodies(scene, stem):
    return [body for body in scene.bodies if body.name.startswith(f"{stem}_")]


@pytest.mark.parametrize("name", NAMES)
def test_nothing_jumps(name: str) -> None:
    """Twists are the derivatives of poses at all times: no pose steps, which would make false events."""
    scene = load_scene(name, {"vary": 1}, visuals=False, seed=11)
    h = 1e-4
    for body in (*bodies(scene, COUNT[name][1]), scene.bodies[0], scene.bodies[1]):
        assert body.trajectory is not None
        t = np.arange(0, 60_000 * MS, 173 * MS)
        step = round(h * 1e9)
        before, after = (body.trajectory.pose(t + s) for s in (-step, step))
        twist = body.trajectory.twist(t)
        assert np.abs((after[:, :3] - before[:, :3]) / (2 * h) - twist[:, :3]).max() < 1e-3
        between = np.abs((before[:, 3:] * after[:, 3:]).sum(-1))
        angle = 2 * np.arccos(np.clip(between, 0, 1))
        assert np.abs(angle / (2 * h) - np.linalg.norm(twist[:, 3:], axis=-1)).max() < 0.05


@pytest.mark.parametrize("name", NAMES)
def test_two_seeds_are_two_worlds(name: str) -> None:
    """In looks and in motion; the same seed is the same world."""
    few = {"vary": 1, COUNT[name][0]: 3}
    first, again, other = (load_scene(name, few, seed=seed) for seed in (1, 1, 2))
    assert appearance(first) == appearance(again) and motion(first) == motion(again)
    assert appearance(first) != appearance(other) and motion(first) != motion(other)
    for a, b in itertools.combinations([m.texture for m in first.materials if m.texture is not None], 2):
        assert a.shape != b.shape or not np.array_equal(a, b)


@pytest.mark.parametrize("name", NAMES)
def test_there_are_as_many_as_asked_for(name: str) -> None:
    argument, stem = COUNT[name]
    for count in (1, 7, 40):
        scene = load_scene(name, {argument: count, "vary": 1}, textures=False)
        assert len(bodies(scene, stem)) == count
        assert sum(i.semantic == stem for i in scene.instances) == count


def test_balls_pass_before_one_another_and_not_through() -> None:
    """At their greatest: the layer of each is deeper than two of them, however many there are."""
    for count in (2, 12, 60):
        for seed in range(3):
            scene = load_scene("balls", {"vary": 1, "balls": count, "radius": 0.3}, textures=False, seed=seed)
            depth = {body.name: body.trajectory.pose(np.zeros(1, np.int64))[0, 1] for body in bodies(scene, "ball")}
            radius = {i.name: float(np.abs(i.mesh.vertices).max()) for i in scene.instances}
            t = np.arange(0, 3000 * MS, 50 * MS)
            for body in bodies(scene, "ball"):
                assert np.ptp(body.trajectory.pose(t)[:, 1]) < 1e-12
            for a, b in itertools.combinations(depth, 2):
                assert abs(depth[a] - depth[b]) > radius[a] + radius[b]


def test_a_ball_is_as_fast_as_its_argument_says() -> None:
    """The greatest speed along each axis is a part, 0.35 to 1, of `speed`."""
    scene = load_scene("balls", {"speed": 10, "balls": 8}, visuals=False)
    t = np.arange(0, 4000 * MS, MS)
    for body in bodies(scene, "ball"):
        fastest = np.abs(body.trajectory.twist(t)[:, [0, 2]]).max(0)
        assert (fastest > 3.4).all() and (fastest <= 10.0 + 1e-9).all()


def test_ambient_light_of_the_tunnel_changes_nothing_but_light() -> None:
    dark, bright = (load_scene("tunnel_exit", {"ambient": value}, textures=False) for value in (0.002, 0.4))
    assert motion(dark) == motion(bright) and appearance(dark) != appearance(bright)
    assert np.allclose(dark.environment, 0.002) and np.allclose(bright.environment, 0.4)
