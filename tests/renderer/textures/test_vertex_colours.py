"""Colours of vertices: interpolated over triangles in perspective, times the albedo, for direct light and for paths."""

import numpy as np
import pytest
from renderer_scenes import at, camera, poses, quad, rays, scene

from evis.geometry import se3
from evis.scene.model import WORLD, Light, Material, Mesh
from nodes.renderer.lights.features import Features
from nodes.renderer.paths.paths import PathOptions
from nodes.renderer.renderer import Renderer

ALBEDO = np.array([0.8, 0.5, 0.25])
CORNERS = np.array([(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.2, 0.4, 0.9)], np.float32)


def coloured(mesh, corners=CORNERS):
    return Mesh(mesh.vertices, mesh.faces, mesh.uv, mesh.normals, corners[mesh.faces].astype(np.float32))


def material(**more):
    return Material("paint", ALBEDO, two_sided=True, **more)


def test_linear_in_space_on_a_tilted_triangle():
    """A linear function of the place on the plane, which is not linear in the image."""
    view, pose = camera(), at(0.05, -0.02, 1.0, (0.3, 1.1, 0.2))
    world = scene([(coloured(quad(0.5, 0.4)), 0, 0)], 1, [material()], view=view, environment=(1.0, 1.0, 1.0))
    images = Renderer(world, view).render(poses(pose, at(0, 0, 0)), None, ("radiance", "ids", "depth"))
    seen = images["ids"][0] == 1
    turn = se3.to_matrix(pose[3:])
    d = rays(view)
    depth = (turn[:, 2] @ pose[:3]) / (d @ turn[:, 2])
    place = (d * depth[..., None] - pose[:3]) @ turn
    u, v = place[..., 0] / 1.0 + 0.5, place[..., 1] / 0.8 + 0.5
    c = CORNERS.astype(np.float64)
    # The diagonal from corner 0 to corner 2 parts the two triangles.
    lower = c[0] + (u - v)[..., None] * (c[1] - c[0]) + v[..., None] * (c[2] - c[0])
    upper = c[0] + u[..., None] * (c[2] - c[0]) + (v - u)[..., None] * (c[3] - c[0])
    expected = ALBEDO * np.where((u >= v)[..., None], lower, upper)
    assert seen.sum() > 300 and np.ptp(depth[seen]) > 0.5
    assert np.abs(images["radiance"][0] - expected)[seen].max() < 2e-5


def test_only_what_has_colours_is_tinted():
    """Beside a mesh with colours, one without has its albedo, bit for bit; a scene without has no code for them."""
    view = camera()
    where = poses(at(-0.3, 0, 1), at(0.3, 0, 1), at(0, 0, 0))
    plain = quad(0.2, 0.2)
    mixed = scene([(plain, 0, 0), (coloured(plain), 1, 0)], 2, [material()], view=view, environment=(1.0, 1.0, 1.0))
    alone = scene([(plain, 0, 0), (plain, 1, 0)], 2, [material()], view=view, environment=(1.0, 1.0, 1.0))
    both, none = Renderer(mixed, view), Renderer(alone, view)
    seen = none.render(where, None, ("ids",))["ids"][0].copy()
    vertex_colours, untinted = (r.render(where, None, ("radiance",))["radiance"][0] for r in (both, none))
    assert np.array_equal(vertex_colours[seen == 1], untinted[seen == 1]) and (seen == 1).sum() > 50
    assert (vertex_colours[seen == 2] < 0.95 * untinted[seen == 2]).any(-1).all()
    assert (
        both.shading.features.vertex_colours
        and not none.shading.features.vertex_colours
        and not Features().vertex_colours
    )


@pytest.mark.parametrize("paths", [None, PathOptions(2, 4)])
def test_one_colour_is_an_albedo(paths):
    """All corners of one colour: as a material of that colour, for diffuse, glossy and metallic ones."""
    view, tint = camera(32, 24, 25.0), np.array([0.25, 0.5, 0.75], np.float32)
    looks = [{}, {"roughness": 0.4}, {"roughness": 0.5, "metallic": 1.0}]
    pictures = []
    for colour, albedo in ((tint, np.ones(3)), (None, tint)):
        mesh = quad(0.6, 0.6) if colour is None else coloured(quad(0.6, 0.6), np.tile(colour, (4, 1)))
        materials = [Material(str(k), albedo, two_sided=True, **look) for k, look in enumerate(looks)]
        light = Light("sun", "directional", np.full(3, 2.0), np.array([0.2, 0.3, 1.0]))
        world = scene([(mesh, k, k) for k in range(3)], 3, materials, [light], view, (0.3, 0.2, 0.1))
        where = poses(at(0, 0, 1.2), at(-0.5, 0, 1.0, (0, 1.2, 0)), at(0.5, 0, 1.0, (0, -1.2, 0)), at(0, 0, 0))
        pictures.append(Renderer(world, view, paths=paths).render(where)["radiance"].astype(np.float64))
    assert pictures[1].max() > 0.2
    np.testing.assert_allclose(*pictures, rtol=1e-4)


def test_paths_find_colours_where_they_are():
    """A gradient looks the same through finer triangles with other first corners: so do weights at a path's hits."""
    view = camera(24, 18, 20.0)
    pictures = []
    for parts, turned in ((1, 0), (3, 1)):
        side = np.linspace(-0.5, 0.5, parts + 1)
        grid = np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)
        vertices = np.concatenate([grid, np.zeros((len(grid), 1))], 1).astype(np.float32)
        i, j = np.divmod(np.arange(parts * parts), parts)
        a = i * (parts + 1) + j
        faces = np.concatenate([np.stack([a, a + 1, a + parts + 2], 1), np.stack([a, a + parts + 2, a + parts + 1], 1)])
        colours = np.stack([grid[:, 0] + 0.5, grid[:, 1] + 0.5, 0.5 - grid[:, 0]], 1)
        floor = coloured(Mesh(vertices, np.roll(faces, turned, 1).astype(np.int32)), colours)
        # The floor is seen by the wall only, and lit.
        light = Light("sun", "directional", np.full(3, 3.0), np.array([0.0, 1.0, 0.3]))
        materials = [material(), Material("wall", np.full(3, 0.7), two_sided=True)]
        meshes = [(floor, WORLD, 0), (quad(0.5, 0.4), WORLD, 1)]
        world = scene(meshes, 0, materials, [light], view)
        world.instances[0].pose = at(0, 0.4, 1.0, (-np.pi / 2, 0, 0))
        world.instances[1].pose = at(0, 0, 1.5)
        renderer = Renderer(world, view, paths=PathOptions(1, 32))
        images = renderer.render(poses(at(0, 0, 0)), None, ("radiance", "ids"))
        pictures.append(np.where((images["ids"] == 2)[..., None], images["radiance"], 0.0).astype(np.float64))
    bright = pictures[0] > 1e-3
    assert bright.sum() > 100 and np.ptp(pictures[0][bright]) > 0.05
    # A ray that meets an edge may find either side of it.
    close = np.isclose(pictures[0], pictures[1], rtol=1e-4, atol=1e-6)
    assert close.mean() > 0.99


def test_colours_that_are_none_are_named():
    for value, words in ((1.5, "has a colour of 1.5; colours of vertices must be 0 ... 1"), (np.nan, "not finite")):
        mesh = coloured(quad(1, 1), np.full((4, 3), value))
        with pytest.raises(ValueError, match=f"instance 'thing0'.*{words}"):
            Renderer(scene([(mesh, WORLD, 0)]), camera())
