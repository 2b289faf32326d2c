"""Supersampling, several cameras of one scene, and what the node says about them."""

import numpy as np
import pytest
from renderer_scenes import GEOMETRIC, Still, at, camera, poses, quad, scene, sphere

from evis.geometry.pinhole import pixel_grid, unproject
from evis.runtime.plan import Plan
from evis.scene.model import Body, Camera, Material
from msgs.header import Header
from msgs.world import WorldState
from nodes.renderer.node import RendererNode
from nodes.renderer.raster.lens.cameras import finer
from nodes.renderer.renderer import Renderer
from nodes.renderer.supersampling import SupersampledRenderer


class Bus:
    """Takes what a node publishes."""

    plan = Plan("alone", "", "")

    def __init__(self, *wanted):
        self.wanted, self.sent, self.counts = set(wanted), {}, {}

    def wants(self, node, port, array=""):
        return port in self.wanted

    def loan(self, node, port, arrays):
        return {name: np.empty(shape, dtype) for name, (shape, dtype) in arrays.items()}

    def publish(self, node, port, message):
        message.check()
        self.sent[port] = message

    def count(self, node, name, amount):
        self.counts[name] = self.counts.get(name, 0) + amount


def world():
    white = Material("white", np.zeros(3), emission=np.ones(3), two_sided=True)
    return scene([(sphere(0.5, 40), 0, 0)], bodies=1, materials=[white], view=camera(32, 24, 30.0))


NOW = at(0.05, 0.02, 1.5), at(0, 0, 0)


def test_the_samples_of_a_pixel_surround_its_centre():
    """Four rays at quarters of a pixel about the pixel's own, to the last digits of float64."""
    view = camera(6, 5, 30.0)
    fine = finer(view, 2)
    assert (fine.width, fine.height) == (12, 10)
    rays = unproject(fine.k, pixel_grid(12, 10), np.ones((10, 12)))
    for dy in (0, 1):
        for dx in (0, 1):
            at_quarter = pixel_grid(6, 5) + np.array([dx / 2 - 0.25, dy / 2 - 0.25])
            expected = unproject(view.k, at_quarter, np.ones((5, 6)))
            np.testing.assert_allclose(rays[dy::2, dx::2], expected, atol=1e-14)


def test_samples_come_side_by_side_and_odd_ones_have_the_pixel_itself_among_them():
    scene_ = world()
    plain = Renderer(scene_, scene_.cameras[0], margin=2)
    fine = Renderer(scene_, scene_.cameras[0], margin=2, supersampling=3)
    before = poses(at(0, 0, 1.6), NOW[1])
    one = {k: v.copy() for k, v in plain.render(poses(*NOW), before, GEOMETRIC).items()}
    many = fine.render(poses(*NOW), before, GEOMETRIC)
    assert fine.array_shape("depth")[0] == (1, 3 * 28, 3 * 36)
    inner = np.s_[:, 1::3, 1::3]
    same = one["ids"] == many["ids"][inner]
    assert same.mean() > 0.999
    np.testing.assert_allclose(one["depth"][same], many["depth"][inner][same], rtol=1e-5)
    np.testing.assert_allclose(3 * one["motion"][same], many["motion"][inner][same], atol=1e-3)


def test_radiance_is_the_covered_share_of_a_pixel():
    """A glowing disk (a ball on the axis) before the dark: its mean is its area, a pixel between 0 and 1 at its rim."""
    scene_ = world()
    renderer = SupersampledRenderer(scene_, scene_.cameras[0], 8)
    image = renderer.render(poses(*NOW), None, ("radiance", "ids"))
    radiance = image["radiance"][0, ..., 0]
    fine = Renderer(scene_, scene_.cameras[0], supersampling=8).render(poses(*NOW))["radiance"][0, ..., 0]
    np.testing.assert_allclose(radiance, fine.reshape(24, 8, 32, 8).mean((1, 3)), atol=1e-6)
    rim = (radiance > 0.05) & (radiance < 0.95)
    assert rim.sum() > 20 and radiance.max() == 1
    assert image["ids"].shape == (1, 24, 32)
    np.testing.assert_array_equal(image["ids"][0][~rim] == 1, radiance[~rim] > 0.5)


def test_what_exceeds_half_precision_is_clipped_and_counted():
    scene_ = world()
    scene_.materials[0].emission = np.full(3, 1e6)
    renderer = SupersampledRenderer(scene_, scene_.cameras[0], 2, half=True)
    radiance = renderer.render(poses(*NOW))["radiance"]
    assert radiance.dtype == np.float16 and radiance.max() == 65504
    assert renderer.counts()[1] == (radiance == 65504).all(-1).sum() > 50


def test_two_cameras_of_different_size_and_lens_see_one_scene():
    """Stereo: the disparity of every pixel of the left image is focal times baseline over its depth."""
    left, right = camera(64, 48, 60.0), camera(64, 48, 60.0)
    right.name = "right"
    scene_ = scene([(quad(4, 4), 0, 0)], bodies=1, view=left)
    scene_.bodies.append(Body("right", Still()))
    scene_.cameras.append(right)
    wide = Camera("right", 40, 30, right.k / 2, 1e-3, "equidistant", (0, 0, 0, 0))
    instant = poses(at(0, 0, 2, (0.3, 0.1, 0)), at(0, 0, 0), at(0.1, 0, 0))
    near = Renderer(scene_, left).render(instant, None, ("depth",))["depth"][0]
    other = Renderer(scene_, right).render(instant, None, ("depth",))["depth"][0]
    row = near[24].astype(float)
    x = np.arange(64) - left.k[0, 0] * 0.1 / row
    seen = (x > 1) & (x < 62)
    # The depth of a plane is not linear along a row; its inverse is.
    np.testing.assert_allclose(1 / np.interp(x, np.arange(64), 1 / other[24].astype(float))[seen], row[seen], rtol=1e-5)
    assert Renderer(scene_, wide).render(instant, None, ("ids",))["ids"].shape == (1, 30, 40)


def node(**params):
    made = RendererNode("renderer", {"scene": "spinning_disk", "width": 48, "height": 36, **params})
    made.runtime = Bus("keyframe", "depth")
    made.setup()
    return made


def test_what_turns_too_fast_for_frames_is_seen_between_them_by_samples_too():
    """A disk of 22 half turns per second at 15 frames: told of frames alone, and of light by paths."""
    given = {name: param.default for name, param in RendererNode.PARAMS.items()}
    given |= {"scene": "spinning_disk", "scene_args": "omega=70", "frame_rate": 15.0, "keyframe_rate": 15.0}
    samples = given | {"supersampling": 2, "resolved": 1e-3}
    told = [RendererNode.foreseen(params) for params in (given, samples, samples | {"bounces": 1})]
    assert [len(lines) > 0 for lines in told] == [True, False, True]


def test_the_node_averages_samples_and_publishes_one_value_per_pixel():
    made = node(supersampling=2, margin=3)
    assert made.runtime.sent["info"].width == 48
    bodies = made.scene.bodies
    pose = np.array([[[b.trajectory.pose(np.array([0]))[0] for b in bodies]]])
    state = WorldState.dense(Header(0, clock="sim"), np.array([0]), pose, np.zeros((*pose.shape[:3], 6)),
                             np.zeros(1, np.int32), names=[b.name for b in bodies])  # fmt: skip
    made.update({"state": state})
    sent = made.runtime.sent
    assert sent["keyframe"].radiance.shape == (1, 42, 54, 3) and sent["depth"].depth.shape == (1, 42, 54)
    plain = node(margin=3)
    plain.update({"state": state})
    np.testing.assert_array_equal(sent["depth"].depth, plain.runtime.sent["depth"].depth)
    assert (sent["keyframe"].radiance != plain.runtime.sent["keyframe"].radiance).any()
    ratio = sent["keyframe"].radiance / plain.runtime.sent["keyframe"].radiance
    assert abs(np.log(np.median(ratio))) < 0.05


def test_the_plan_says_that_the_background_is_kept():
    said = RendererNode.imports({"scene": "spinning_disk", "camera": "cam0"})
    assert list(said) == ["static background"]
    assert said["static background"] == "cam0 never moves: the world drawn once and kept"
    for params in ({"scene": "falling_objects", "camera": "cam0"}, {"scene": "spinning_disk", "camera": "cam7"},
                   {"scene": "nowhere", "camera": "cam0"}, {"scene": None}):  # fmt: skip
        assert RendererNode.imports(params) == {}


@pytest.mark.parametrize("name", ["plumb_bob", "equidistant"])
def test_the_info_carries_the_lens(name, tmp_path):
    coefficients = [-0.1, 0.01, 0.001, 0.002]
    path = tmp_path / "lens.yaml"
    path.write_text(
        "description: a plate\n"
        f"cameras:\n  cam0: {{position: [0, 0, 1], look_at: [0, 1, 1], fov: 40 deg, "
        f"distortion: {{model: {name}, coefficients: {coefficients}}}}}\n"
        "materials:\n  grey: {albedo: 0.5}\n"
        "world:\n  - {name: wall, shape: plane, size: [4, 3], position: [0, 2, 1], "
        "rotation: {axis: [1, 0, 0], angle: 90 deg}, material: grey}\n"
        "environment: 0.15\n"
    )
    info = node(scene=str(path)).runtime.sent["info"]
    assert info.distortion_model == name
    np.testing.assert_array_equal(info.distortion, coefficients)
