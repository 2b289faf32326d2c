"""The paper's disk: its ranges, its textures, and the radiance range in the frame."""

import numpy as np
import pytest

from evis.geometry import pinhole, se3
from evis.scene import load_scene, scene_args
from evis.scene.images import textures as made


def test_the_paper_s_ranges():
    """[15, 70] rad/s, [25, 45] deg, a quarter of the frame, [0.8, 1.1] m, five textures."""
    args = scene_args("spinning_disk")
    ranges = {k: (args[k].minimum, args[k].maximum) for k in ("omega", "tilt", "standoff", "texture")}
    assert ranges == {"omega": (15, 70), "tilt": (25, 45), "standoff": (0.8, 1.1), "texture": (0, 4)}
    for bad in ({"centre": "0.26,0"}, {"omega": 71}, {"tilt": 24}, {"standoff": 0.7}, {"texture": 5}):
        with pytest.raises(ValueError, match=r"the (most|least) is"):
            load_scene("spinning_disk", bad, textures=False)


@pytest.mark.parametrize("tilt", [25.0, 45.0])
def test_tilt_and_rate(tilt):
    """The disk's axis makes the angle `tilt` with the optical axis, and the twist is omega along it."""
    scene = load_scene("spinning_disk", {"tilt": tilt, "omega": 15}, textures=False)
    disk, camera = (scene.bodies[scene.body_index(n)].trajectory for n in ("disk", "cam0"))
    t = np.array([0, 333_333_333])
    axis = se3.rotate(disk.pose(t)[:, 3:], np.array([0.0, 0.0, 1.0]))
    optical = se3.rotate(camera.pose(t)[:, 3:], np.array([0.0, 0.0, 1.0]))
    assert np.allclose(np.degrees(np.arccos(-np.sum(axis * optical, axis=-1))), tilt)
    assert np.allclose(disk.twist(t)[:, 3:], 15 * axis) and camera.is_static()


def test_the_disk_stays_in_the_frame():
    """At mid standoff, with the centre a quarter of the frame off in each direction."""
    for offset in ("0.25,0.25", "-0.25,-0.25"):
        scene = load_scene("spinning_disk", {"centre": offset}, textures=False)
        disk = next(i for i in scene.instances if i.name == "disk")
        poses = [scene.bodies[scene.body_index(n)].trajectory.pose(np.zeros(1, np.int64))[0] for n in ("disk", "cam0")]
        points = se3.transform(se3.inverse(poses[1]), se3.transform(poses[0], disk.mesh.vertices.astype(float)))
        pixels = pinhole.project(scene.cameras[0].k, points)
        assert pixels.min() > 0 and (pixels < [345, 259]).all()


def test_textures_are_five_and_differ():
    """Black and white in equal parts but for the wedge; features get smaller from 0 to 4."""
    images = [load_scene("spinning_disk", {"texture": k}).materials[0].texture[..., 0] for k in range(5)]
    edges = []
    for image in images:
        assert image.shape == (112, 112) and image.min() >= 0.02 and image.max() <= 0.91
        assert abs(np.mean(image > 0.5) - 0.5) < 0.1
        edges.append(np.mean(np.abs(np.diff(image, axis=0))))
    assert np.all(np.diff(edges) > 0), edges


def test_texture_is_about_one_texel_per_pixel():
    """Twice the image height: twice the texels across."""
    sizes = [len(load_scene("spinning_disk", {"height": h}).materials[0].texture) for h in (260, 520)]
    assert sizes[1] in (2 * sizes[0], 2 * sizes[0] + 1)


def test_wedge_is_a_grey_sector_around_the_top():
    """Its area is angle / 2 pi of any disk around the centre, and it lies upwards."""
    image = made.add_wedge(np.zeros((201, 201), np.float32), np.radians(40), 1.0)
    y, x = np.mgrid[100:-101:-1, -100:101]
    disk = np.hypot(x, y) < 95
    assert abs(image[disk].sum() / disk.sum() - 40 / 360) < 2e-3
    assert image[5, 100] == 1.0 and image[195, 100] == 0.0 and image[100, 5] == image[100, 195] == 0.0


def test_seed_decides_the_texture():
    """Same seed, same bytes; another seed, another image."""
    a, b, c = (made.blobs(64, seed, 0.03) for seed in (1, 1, 2))
    assert a.tobytes() == b.tobytes() and np.abs(a - c).mean() > 0.1


def test_shrinking_keeps_the_mean_and_kills_what_is_finer_than_a_texel():
    """A checker finer than the texels becomes grey, not a moire."""
    assert np.ptp(made.checker(64, 256)) < 0.02
    assert abs(made.checker(64, 256).mean() - 0.5) < 1e-3


def test_lamp_and_shade_are_more_than_a_thousand_to_one():
    """Brightest emission against the darkest surface in nothing but ambient light."""
    scene = load_scene("spinning_disk")
    brightest = max(m.emission.max() for m in scene.materials)
    darkest = min(
        (m.albedo * (m.texture.min() if m.texture is not None else 1)).max() * scene.environment.max()
        for m in scene.materials
        if not m.emission.any()
    )
    white = next(m for m in scene.materials if m.name == "pattern").texture.max()
    light = scene.lights[0]
    disk = scene.bodies[0].trajectory.pose(np.zeros(1, np.int64))[0, :3]
    irradiance = light.colour.max() / np.sum((light.vector - disk) ** 2)
    assert brightest > 1000 * darkest and brightest > 50 * white * irradiance / np.pi


@pytest.mark.parametrize("height", [1, 2, 5, 6, 260, 7900, 7901, 8192])
@pytest.mark.parametrize("standoff", [0.8, 1.1])
def test_any_image_has_a_texture_of_a_size_that_there_may_be(monkeypatch, height, standoff):
    """A texel for each pixel across the disk of 0.3 m, 2 to 4096 of them; all alike here, for others take long."""
    asked = []

    def blobs(size, *how):
        asked.append(size)
        return np.ones((1, 1), np.float32)

    monkeypatch.setattr(made, "blobs", blobs)
    scene = load_scene("spinning_disk", {"width": 1, "height": height, "standoff": standoff})
    (size,) = asked
    across = scene.cameras[0].k[1, 1] * 0.3 / standoff
    assert 2 <= size <= 4096 and abs(size - np.clip(across, 2, 4096)) <= 1 + 0.01 * across
