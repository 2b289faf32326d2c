"""The scenes that come with evis: every camera of each sees something, and each is what its page says."""

import numpy as np
import pytest

from evis.config.paths import names
from evis.demo.gallery import light_range
from evis.scene import load_scene
from nodes.physics.engines.prescribed import prescribed_states

SIZE = {"width": 86, "height": 65}


def states(scene, t_ns):
    """Poses [N, 7] of all bodies at a time."""
    if not scene.dynamic:
        return prescribed_states(scene, np.array([t_ns]))[0][0]
    from nodes.physics.engines.mujoco_engine import MujocoEngine

    engine = MujocoEngine(scene)
    return (engine.advance(t_ns) if t_ns else engine.start()).pose[0, -1]


@pytest.fixture(scope="module")
def scenes():
    return {name: load_scene(name, SIZE, textures=False) for name in names("scenes")}


def test_they_are_all_there(scenes):
    """The gallery's names."""
    wanted = {"spinning_disk", "falling_objects", "robot_arm", "warehouse", "drone", "tunnel_exit", "fidget_spinner"}
    assert wanted | {"stereo_room"} <= set(scenes)


@pytest.mark.parametrize("name", names("scenes"))
@pytest.mark.parametrize("t_ns", [0, 350_000_000])
def test_every_camera_sees_something(scenes, name, t_ns):
    """At least three things, and no more sky than half of the picture."""
    from nodes.renderer.raster.visibility import Visibility

    scene = scenes[name]
    poses = states(scene, t_ns)
    assert np.isfinite(poses).all()
    for camera in scene.cameras:
        visibility = Visibility(scene, camera)
        visibility.update(poses[None])
        seen = visibility.hits()["instance"]
        assert len(np.unique(seen[seen >= 0])) >= 3, camera.name
        assert np.mean(seen >= 0) > 0.5, camera.name


@pytest.mark.parametrize("name", names("scenes"))
@pytest.mark.parametrize("t_ns", [0, 350_000_000])
def test_no_two_surfaces_lie_in_each_other(name, t_ns):
    """Which of them a pixel shows would hang on rounding. A camera that is 1 um aside sees the same things, but where
    an edge happens to pass a pixel's centre; it is turned a little, so that no edge runs along a row of these."""
    from evis.geometry import se3
    from nodes.renderer.raster.visibility import Visibility

    scene = load_scene(name, {"width": 311, "height": 233}, textures=False)
    poses = states(scene, t_ns)
    turned = se3.normalize(np.array([0.013, 0.007, 0.021, 1.0]))
    for camera in scene.cameras:
        visibility, seen = Visibility(scene, camera), []
        body = visibility.camera_body
        for place in 1e-6 * np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, 0, 1]]):
            moved = poses.copy()
            moved[body] = se3.compose(poses[body], np.array([*place, *turned]))
            visibility.update(moved[None])
            seen.append(visibility.hits()["instance"])
        assert max(np.sum(there != seen[0]) for there in seen[1:]) <= 8, camera.name


@pytest.mark.parametrize("name", names("scenes"))
def test_something_moves(scenes, name):
    """A scene in which nothing moves makes no events."""
    scene = scenes[name]
    assert np.abs(states(scene, 0) - states(scene, 50_000_000)).max() > 1e-3


@pytest.mark.parametrize("name", names("scenes"))
def test_bodies_are_the_same_without_visuals(scenes, name):
    """What physics loads and what the renderer loads must agree on body n."""
    bare = load_scene(name, SIZE, visuals=False)
    assert [b.name for b in bare.bodies] == [b.name for b in scenes[name].bodies] and not bare.instances
    assert [c.name for c in bare.cameras] == [c.name for c in scenes[name].cameras]


def test_warehouse_is_of_medium_complexity(scenes):
    """>= 500 bodies, >= 200 000 triangles, >= 12 lights; its shapes share their meshes."""
    scene = scenes["warehouse"]
    meshes = {id(i.mesh) for i in scene.instances}
    assert len(scene.bodies) >= 500 and len(scene.lights) >= 12
    assert sum(len(i.mesh.faces) for i in scene.instances) >= 200_000 and len(meshes) < 100
    textured = [m.name for m in load_scene("warehouse", SIZE).materials if m.texture is not None]
    assert len(textured) >= 8


def test_wheels_roll(scenes):
    """The point of a wheel that touches the floor stands still, whatever the time; the same for the barrel."""
    scene = scenes["warehouse"]
    for name, radius in (("wheel_0_0", 0.25), ("wheel_1_1", 0.25), ("barrel", 0.28)):
        twist = scene.bodies[scene.body_index(name)].trajectory.twist(np.arange(5) * 777_000_000)
        touching = twist[:, :3] + np.cross(twist[:, 3:], [0, 0, -radius])
        assert np.abs(twist[:, 1]).max() > 0.5 and np.abs(touching).max() < 1e-9, name


def test_stereo_cameras_are_a_pair(scenes):
    """6 cm apart along their common x axis, at any time."""
    from evis.geometry import se3

    poses = states(scenes["stereo_room"], 700_000_000)
    left, right = (poses[scenes["stereo_room"].body_index(n)] for n in ("left", "right"))
    assert np.allclose(se3.compose(se3.inverse(left), right), [0.06, 0, 0, 0, 0, 0, 1], atol=1e-12)


def test_tunnel_has_120_db():
    """Between its darkest and its brightest pixel in one keyframe."""
    from nodes.renderer.renderer import Renderer

    scene = load_scene("tunnel_exit", SIZE)
    image = Renderer(scene, scene.cameras[0]).render(states(scene, 0)[None])["radiance"]
    assert light_range(image) > 120


def test_light_range():
    """20 log10 of a ratio; black and non-finite pixels do not count."""
    image = np.zeros((2, 3, 3))
    image[0, 0], image[0, 1], image[1, 1] = 1e-3, 1e3, np.nan
    assert np.isclose(light_range(image), 120) and light_range(image * 0) == 0
