"""Radiance against closed form, on planes and spheres, with lights, shadows and textures."""

import numpy as np
import pytest
from renderer_scenes import at, camera, poses, quad, rays, scene, sphere

from evis.scene.model import WORLD, Light, Material, Mesh
from nodes.renderer.renderer import Renderer

ALBEDO = np.array([0.5, 0.25, 0.8])
NOWHERE = at(0, 0, -50)


def lights(*given):
    """Both kinds, so that all tests share one kernel; what is not given is dark."""
    dark = np.zeros(3)
    return [
        *given,
        Light("no sun", "directional", dark, np.array([0, 0, 1.0])),
        Light("no bulb", "point", dark, np.array([0, 0, -3.0])),
    ]


def world(meshes, given=(), materials=None, **more):
    """Camera at the origin looking along +z; body0 moves. The materials end with a textured one."""
    texture = np.random.default_rng(0).random((3, 5, 3)).astype(np.float32)
    materials = [Material("grey", ALBEDO), *(materials or []), Material("textured", np.ones(3), texture=texture)]
    bodies = 1 + max((body for _, body, _ in meshes), default=0)
    unseen = [(sphere(1e-3, 2), 0, len(materials) - 1)]
    return scene(meshes + unseen, bodies=max(bodies, 1), materials=materials, lights=lights(*given), **more)


def facing(size=20.0, z=2.0):
    """A plane of the static world that faces the camera."""
    mesh = quad(size, size)
    vertices = mesh.vertices * np.array([1, -1, -1], np.float32) + np.array([0, 0, z], np.float32)
    return Mesh(vertices, mesh.faces, mesh.uv)


def render(scene_, *bodies, **more):
    renderer = Renderer(scene_, scene_.cameras[0], **more)
    return renderer.render(poses(*bodies, at(0, 0, 0)))["radiance"][0].copy(), renderer


def test_directional_light_and_environment_on_a_plane():
    direction = np.array([0.3, -0.2, 1.0])
    sun = Light("sun", "directional", np.array([3.0, 2.0, 1.0]), direction)
    sky = np.array([0.1, 0.2, 0.3])
    image, _ = render(world([(facing(), WORLD, 0)], [sun], environment=sky), NOWHERE)
    expected = ALBEDO / np.pi * sun.colour * (1 / np.linalg.norm(direction)) + ALBEDO * sky
    np.testing.assert_allclose(image, np.broadcast_to(expected, image.shape), rtol=1e-6)


def test_inverse_square_of_a_point_light():
    bulb = Light("bulb", "point", np.array([5.0, 4.0, 3.0]), np.array([0.4, -0.3, 1.2]))
    scene_ = world([(facing(z=2.0), WORLD, 0)], [bulb])
    image, _ = render(scene_, NOWHERE)
    to_light = bulb.vector - 2.0 * rays(scene_.cameras[0])
    distance = np.linalg.norm(to_light, axis=-1, keepdims=True)
    expected = ALBEDO / np.pi * bulb.colour * (0.8 / distance) / distance**2
    np.testing.assert_allclose(image, expected, rtol=2e-6)


def test_a_light_moves_with_its_body():
    at_rest = Light("bulb", "point", np.full(3, 2.0), np.array([0.3, 0.1, 1.0]))
    carried = Light("bulb", "point", np.full(3, 2.0), np.array([0.0, 0.0, 0.2]), body=0)
    place = at(0.3, 0.1, 1.2, (np.pi, 0, 0))
    meshes = [(facing(), WORLD, 0)]
    fixed = render(world(meshes, [at_rest]), NOWHERE)[0]
    # The body carries a sphere of 1 mm, 0.2 m behind the light.
    np.testing.assert_allclose(render(world(meshes, [carried]), place)[0], fixed, rtol=1e-5)
    sun = Light("sun", "directional", np.full(3, 2.0), np.array([0.0, 0, -1]), body=0)
    np.testing.assert_allclose(render(world(meshes, [sun]), place)[0], np.broadcast_to(2 * ALBEDO / np.pi, fixed.shape))


@pytest.mark.parametrize("kind", ["point", "directional"])
def test_shadow_edges_are_where_geometry_puts_them(kind):
    source = np.array([0.7, 0.4, 0.3]) if kind == "point" else np.array([-0.5, -0.3, 1.0])
    light = Light("light", kind, np.full(3, 4.0), source)
    half = 0.25
    scene_ = world([(facing(z=2.0), WORLD, 0), (quad(half, half), 0, 0)], [light], view=camera(120, 90, 50.0))
    place = at(0.2, 0.1, 1.0, (np.pi, 0, 0))
    image, renderer = render(scene_, place)
    ids = renderer.render(poses(place, at(0, 0, 0)), None, ("ids",))["ids"][0]
    point = 2.0 * rays(scene_.cameras[0])
    towards = source - point if kind == "point" else np.broadcast_to(-source, point.shape)
    crossing = point + towards * ((1.0 - point[..., 2]) / towards[..., 2])[..., None]
    outside = np.abs(crossing[..., :2] - [0.2, 0.1]).max(-1) - half
    floor = ids == 1
    shaded = floor & (outside < -1e-5)
    lit = floor & (outside > 1e-5)
    assert shaded.sum() > 100 and lit.sum() > 3000
    assert (image[shaded] == 0).all() and (image[lit] > 0).all()


def test_lights_without_shadows_pass_through():
    light = Light("light", "directional", np.full(3, 4.0), np.array([-0.5, -0.3, 1.0]), shadows=False)
    scene_ = world([(facing(z=2.0), WORLD, 0), (quad(0.25, 0.25), 0, 0)], [light])
    image, _ = render(scene_, at(0.2, 0.1, 1.0, (np.pi, 0, 0)))
    assert (image > 0).all()


def test_what_is_beyond_a_point_light_throws_no_shadow():
    bulb = Light("bulb", "point", np.full(3, 4.0), np.array([0.0, 0.0, 1.5]))
    meshes = [(facing(z=2.0), WORLD, 0), (quad(0.1, 0.1), 0, 0)]
    image, _ = render(world(meshes, [bulb]), at(0, 0.05, 1.42, (np.pi, 0, 0)))
    alone, _ = render(world(meshes[:1], [bulb]), NOWHERE)
    seen = alone != image
    # Only where the plate itself is seen: it covers (-0.1..0.1, -0.05..0.15) at z = 1.42.
    point = 1.42 * rays(camera())[..., :2]
    plate = (np.abs(point - [0, 0.05]) < 0.1 + 1e-6).all(-1)
    assert plate.sum() > 20 and not seen[~plate].any()


@pytest.mark.parametrize("convex", [True, False])
def test_a_curved_body_shades_its_dark_side_and_not_its_bright_one(convex):
    """n.l > 0 is lit without a speck, n.l < 0 dark; smooth normals follow the sphere.

    With a speck of its own beside it the mesh is not convex, and its shadow rays must not meet the facet they start on.
    """
    ball, speck = sphere(0.5, 60), sphere(0.01, 3)
    if not convex:
        vertices = np.concatenate([ball.vertices, speck.vertices + np.array([0, 0, 3], np.float32)])
        faces = np.concatenate([ball.faces, speck.faces + len(ball.vertices)])
        ball = Mesh(vertices, faces, None, np.concatenate([ball.normals, speck.normals]))
    sun = Light("sun", "directional", np.full(3, np.pi), np.array([-1.0, 0.4, 0.7]))
    scene_ = world([(ball, 0, 0)], [sun], view=camera(120, 90, 120.0))
    centre = np.array([0, 0, 1.5])
    image, renderer = render(scene_, at(*centre))
    d = rays(scene_.cameras[0])
    depth = renderer.render(poses(at(*centre), at(0, 0, 0)), None, ("depth",))["depth"][0]
    seen = np.isfinite(depth)
    normal = np.where(seen, depth, 0)[..., None] * d - centre
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    cosine = normal @ (-sun.vector / np.linalg.norm(sun.vector))
    bright, dark = seen & (cosine > 0.06), seen & (cosine < -0.06)
    assert bright.sum() > 4000 and dark.sum() > 400
    # Facets of 3 deg: the hit point is off the sphere by 3e-4 of the radius.
    np.testing.assert_allclose(image[bright], cosine[bright, None] * ALBEDO, atol=2e-3)
    assert (image[dark] == 0).all()


def test_bilinear_texture():
    scene_ = world([], view=camera(96, 72, 80.0))
    texture = scene_.materials[-1].texture
    plane = quad(0.6, 0.5)
    scene_.instances[0].mesh = plane
    scene_.environment = np.ones(3, np.float32)
    place = at(0, 0, 1.0, (np.pi, 0, 0))
    image, renderer = render(scene_, place)
    seen = renderer.render(poses(place, at(0, 0, 0)), None, ("ids",))["ids"][0] == 1
    point = rays(scene_.cameras[0])
    u, v = (point[..., 0] + 0.6) / 1.2, (-point[..., 1] + 0.5) / 1.0
    x, y = u * 5 - 0.5, (1 - v) * 3 - 0.5
    i, j = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - i)[..., None], (y - j)[..., None]
    texel = lambda a, b: texture[b % 3, a % 5].astype(float)
    expected = (1 - fy) * ((1 - fx) * texel(i, j) + fx * texel(i + 1, j))
    expected += fy * ((1 - fx) * texel(i, j + 1) + fx * texel(i + 1, j + 1))
    assert seen.mean() > 0.5
    np.testing.assert_allclose(image[seen], expected[seen], atol=1e-5)


def test_a_textured_material_on_a_mesh_without_coordinates_is_plain():
    plane = facing()
    plane.uv = None
    scene_ = world([(plane, WORLD, 1)], environment=np.array([1.0, 2.0, 3.0]))
    scene_.materials[1].albedo = ALBEDO
    image, _ = render(scene_, NOWHERE)
    np.testing.assert_allclose(image, np.broadcast_to(ALBEDO * [1, 2, 3], image.shape), rtol=1e-6)


def test_emission_is_added_and_two_sided_surfaces_are_lit_from_the_viewers_side():
    glow = Material("glow", np.full(3, 0.5), emission=np.array([7.0, 8, 9]), two_sided=True)
    sun = Light("sun", "directional", np.full(3, np.pi), np.array([0, 0, 1.0]))
    for turn, from_front in ((0.0, True), (np.pi, True), (0.0, False), (np.pi, False)):
        sun.vector = np.array([0, 0, 1.0 if from_front else -1.0])
        image, _ = render(world([(quad(5, 5), 0, 1)], [sun], [glow]), at(0, 0, 2, (turn, 0, 0)))
        expected = np.array([7.0, 8, 9]) + 0.5 * from_front
        np.testing.assert_allclose(image, np.broadcast_to(expected, image.shape), rtol=1e-6)


def lit_room():
    """A wall, a still ball, a moving plate, two lights; everything throws shadows on something."""
    sun = Light("sun", "directional", np.array([3.0, 2, 1]), np.array([0.3, 0.4, 1.0]))
    bulb = Light("bulb", "point", np.array([1.0, 2, 3]), np.array([-0.5, 0.2, 0.4]))
    meshes = [(facing(z=2.0), WORLD, 0), (sphere(0.2, 12), WORLD, 0), (quad(0.15, 0.1), 0, 0)]
    scene_ = world(meshes, [sun, bulb], view=camera(90, 70, 60.0))
    scene_.instances[1].pose = at(-0.2, 0.2, 1.5)
    return scene_


def test_radiance_is_linear_in_light():
    scene_ = lit_room()
    place = at(0.1, 0.1, 1.0, (2.8, 0.2, 0))
    once = render(scene_, place)[0]
    for light in scene_.lights:
        light.colour = light.colour * 2
    np.testing.assert_array_equal(render(scene_, place)[0], 2 * once)
    sun, bulb = (l.colour / 2 for l in scene_.lights[:2])
    parts = []
    for a, b in ((sun, 0 * bulb), (0 * sun, bulb)):
        scene_.lights[0].colour, scene_.lights[1].colour = a, b
        parts.append(render(scene_, place)[0])
    np.testing.assert_allclose(parts[0] + parts[1], once, rtol=1e-6)


def test_ratio_of_a_billion():
    bright = Material("bright", np.ones(3), emission=np.full(3, 1e6), two_sided=True)
    sun = Light("sun", "directional", np.full(3, 1e-3), np.array([0, 0, 1.0]))
    image, renderer = render(world([(facing(), WORLD, 0), (quad(0.2, 0.2), 0, 1)], [sun], [bright]), at(0, 0, 1))
    ids = renderer.render(poses(at(0, 0, 1), at(0, 0, 0)), None, ("ids",))["ids"][0]
    dim = image[ids == 1]
    np.testing.assert_allclose(dim, np.broadcast_to(ALBEDO * 1e-3 / np.pi, dim.shape), rtol=1e-6)
    assert (image[ids == 2] >= 1e6).all() and (ids == 2).any()


def test_remembered_shadows_change_no_bit():
    """One renderer over a run, with rests and a camera move, against a new one for every image."""
    scene_ = lit_room()
    places = [at(0.1 * np.sin(k), 0.1 * np.cos(k), 1.0 + 0.02 * k, (2.8, 0.2, k)) for k in range(6)]
    run = [(places[k], at(0, 0, 0)) for k in (0, 1, 2, 2, 2, 3)]
    run += [(places[k], at(0.05, 0, 0, (0, 0, 0.1))) for k in (3, 4, 4)] + [(places[5], at(0, 0, 0))]
    kept = Renderer(scene_, scene_.cameras[0])
    threaded = Renderer(scene_, scene_.cameras[0], threads=2)
    for step in run:
        new = Renderer(scene_, scene_.cameras[0]).render(poses(*step))["radiance"]
        np.testing.assert_array_equal(kept.render(poses(*step))["radiance"], new)
        np.testing.assert_array_equal(threaded.render(poses(*step))["radiance"], new)


def test_a_shadowless_kernel_gives_what_the_full_one_gives_in_the_open():
    sun = Light("sun", "directional", np.array([3.0, 2, 1]), np.array([0.3, 0.4, 1.0]))
    full = render(world([(facing(), WORLD, 0)], [sun]), NOWHERE)[0]
    sun.shadows = False
    lean = scene([(facing(), WORLD, 0)], materials=[Material("grey", ALBEDO)], lights=[sun])
    np.testing.assert_array_equal(render(lean)[0], full)


def test_margin_environments_and_float16():
    scene_ = lit_room()
    place, eye = at(0.1, 0.1, 1.0, (2.8, 0.2, 0)), at(0, 0, 0)
    image = render(scene_, place)[0]
    np.testing.assert_array_equal(render(scene_, place, margin=4)[0][4:-4, 4:-4], image)
    two = Renderer(scene_, scene_.cameras[0], envs=2)
    both = two.render(np.concatenate([poses(NOWHERE, eye), poses(place, eye)]))["radiance"]
    np.testing.assert_array_equal(both[1], image)
    np.testing.assert_array_equal(both[0], render(scene_, NOWHERE)[0])
    half, renderer = render(scene_, place, half=True)
    assert half.dtype == np.float16 and renderer.counts()[1] == 0
    np.testing.assert_array_equal(half, image.astype(np.float16))
    scene_.lights[0].colour = np.full(3, 1e7)
    half, renderer = render(scene_, place, half=True)
    assert half.max() == np.float16(65504) and renderer.counts()[1] == (half == np.float16(65504)).any(-1).sum() > 0


def test_what_is_not_finite_is_replaced_and_counted():
    sun = Light("sun", "directional", np.full(3, 3e38), np.array([0, 0, 1.0]))
    other = Light("other", "directional", np.full(3, 3e38), np.array([0, 0, 1.0]))
    scene_ = world([(facing(), WORLD, 0)], [sun, other])
    scene_.environment = np.full(3, 1.0, np.float32)
    image, renderer = render(scene_, NOWHERE)
    assert renderer.counts()[0] == image.shape[0] * image.shape[1]
    assert np.isfinite(image).all() and (image == np.float32(3e38)).all()


def test_given_arrays_are_written_in_place_and_wrong_ones_refused():
    scene_ = lit_room()
    renderer = Renderer(scene_, scene_.cameras[0])
    moves = poses(at(0.1, 0.1, 1.0), at(0, 0, 0))
    out = {name: np.empty(*renderer.array_shape(name)) for name in ("radiance", "depth")}
    again = {name: np.empty_like(array) for name, array in out.items()}
    result = renderer.render(moves, None, out, out)
    assert result["radiance"] is out["radiance"] and out["radiance"].max() > 0
    renderer.render(moves, None, again, again)
    for name in out:
        np.testing.assert_array_equal(out[name], again[name])
    with pytest.raises(ValueError, match=r"out\['depth'\] must be a writable contiguous array"):
        renderer.render(moves, None, ("depth",), {"depth": np.zeros((3, 3), np.float32)})
    with pytest.raises(ValueError, match="no output 'flow'; it has radiance"):
        renderer.render(moves, None, ("flow",))


def test_unusable_lights_and_materials_are_refused():
    plane = [(facing(), WORLD, 0)]
    for light, text in (
        (Light("l", "laser", np.ones(3), np.ones(3)), "light 'l' is of kind 'laser'; kinds are directional, point"),
        (Light("l", "directional", np.ones(3), np.zeros(3)), "light 'l' has vector"),
        (Light("l", "point", -np.ones(3), np.ones(3)), "light 'l' colour is"),
        (Light("l", "point", np.ones(3), np.ones(3), body=9), "light 'l' is on body 9"),
    ):
        with pytest.raises(ValueError, match=text):
            render(scene(plane, lights=[light]))
    with pytest.raises(ValueError, match="material 'm' albedo is"):
        render(scene(plane, materials=[Material("m", np.full(3, np.nan))]))
    with pytest.raises(ValueError, match="texture of material 'm' must be finite"):
        render(scene(plane, materials=[Material("m", np.ones(3), texture=np.ones((2, 2), np.float32))]))
