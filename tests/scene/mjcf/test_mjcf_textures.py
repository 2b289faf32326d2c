"""Textures of a MuJoCo model lie as MuJoCo's renderer lays them: places of edges measured in its pictures."""

import itertools
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image

from evis.geometry import se3
from evis.scene import SceneError, load_scene
from evis.scene.folders import Folders
from evis.scene.mjcf.compiling.compile import compile_drawn
from evis.scene.model import Mesh, Scene

CHECKER = '<texture name="t" type="2d" builtin="checker" rgb1="1 1 1" rgb2="0 0 0" width="64" height="64"/>'


def load(folder: Path, asset: str, body: str) -> Scene:
    path = folder / "m.xml"
    path.write_text(f"<mujoco><asset>{asset}</asset><worldbody>{body}</worldbody></mujoco>")
    return load_scene(str(path))


def grey_picture(path: Path) -> None:
    """A PNG of grey 128 without an sRGB chunk: MuJoCo's compiler calls what it decodes linear."""
    Image.fromarray(np.full((4, 4, 3), 128, np.uint8)).save(path)
    assert b"sRGB" not in path.read_bytes()


GREY = ((128 / 255 + 0.055) / 1.055) ** 2.4
"""The radiance of grey 128 (IEC 61966-2-1)."""


@pytest.mark.parametrize(
    ("how", "radiance"),
    [("", GREY), ('embed="false"', GREY), ('colorspace="sRGB"', GREY), ('colorspace="linear"', 128 / 255)],
)
def test_a_picture_is_linear_only_where_the_file_says_so(tmp_path, how, radiance):
    """MuJoCo's renderer shows grey 128 of a plain PNG as it shows rgba 128 / 255; by reference or not."""
    grey_picture(tmp_path / "p.png")
    texture = f'<texture name="t" type="2d" file="p.png" {how}/><material name="m" texture="t"/>'
    materials = load(tmp_path, texture, '<geom size="1" material="m"/><geom size="1" rgba=".501961 0 0 1"/>').materials
    assert materials[0].texture is not None and np.allclose(materials[0].texture, radiance, atol=1e-6)
    assert np.isclose(materials[1].albedo[0], GREY, atol=1e-6)


def test_parts_of_a_model_keep_the_colour_spaces_that_they_state(tmp_path):
    """Textures that are attached twice and included: their numbers are others than in their own files."""
    grey_picture(tmp_path / "p.png")
    grey = '<texture name="{0}" type="2d" file="p.png" {1}/><material name="{0}" texture="{0}"/>'
    linear, default = grey.format("l", 'colorspace="linear"'), grey.format("d", 'class="raw"')
    body = '<body name="b"><geom size="1" material="l"/><geom size="1" material="d"/></body>'
    (tmp_path / "part.xml").write_text(
        '<mujoco><default><default class="raw"><texture colorspace="linear"/></default></default>'
        f"<asset>{linear}{default}</asset><worldbody>{body}</worldbody></mujoco>"
    )
    (tmp_path / "more.xml").write_text(f"<mujoco><asset>{grey.format('i', '')}</asset></mujoco>")
    asset = CHECKER + '<model name="part" file="part.xml"/></asset><include file="more.xml"/><asset>'
    attached = "".join(f'<attach model="part" body="b" prefix="{k}"/>' for k in "xy")
    scene = load(tmp_path, asset, f'<geom size="1" material="i"/>{attached}')
    seen = {material.name: float(material.texture[0, 0, 0]) for material in scene.materials}
    raw = dict.fromkeys(("xl", "xd", "yl", "yd"), 128 / 255)
    assert seen == pytest.approx({"i": GREY, **raw})


@pytest.mark.parametrize("compiler", ["", '<compiler passthrough="textures"/>'])
@pytest.mark.parametrize("kind", ["2d", "cube", "skybox"])
def test_a_texture_by_reference_is_drawn_as_one_within_the_model(tmp_path, compiler, kind):
    """`embed="false"`, and `passthrough` for all; the model steps as it did."""
    Image.fromarray(np.arange(48, dtype=np.uint8).reshape(4, 4, 3)).save(tmp_path / "p.png")
    path = tmp_path / "m.xml"
    scenes = {}
    for embed in ("true", "false"):
        stated = "" if compiler else f'embed="{embed}"'
        texture = f'<texture name="t" type="{kind}" file="p.png" {stated}/>'
        material = '<material name="m" texture="t"/>' if kind != "skybox" else '<material name="m"/>'
        path.write_text(
            f"<mujoco>{compiler if embed == 'false' else ''}<asset>{texture}{material}</asset><worldbody>"
            '<geom type="plane" size="1 1 1" material="m"/><body pos="0 0 1" euler="10 20 30"><freejoint/>'
            '<geom type="box" size=".1 .2 .3" material="m"/></body></worldbody></mujoco>'
        )
        scenes[embed] = load_scene(str(path))
    inside, outside = (scenes[embed] for embed in ("true", "false"))
    for a, b in [(inside.environment_map, outside.environment_map)] + [
        (x.texture, y.texture) for x, y in zip(inside.materials, outside.materials, strict=True)
    ]:
        assert np.array_equal(a, b) if a is not None else b is None
    assert (outside.environment_map if kind == "skybox" else outside.materials[0].texture) is not None
    states = []
    for model in (mujoco.MjModel.from_xml_path(str(path)), compile_drawn(path, Folders(tmp_path))):
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 500)
        states.append(data.qpos.copy())
    assert np.array_equal(*states) and states[0][2] < 0.9


def test_a_texture_by_reference_that_is_not_there_is_named(tmp_path):
    with pytest.raises(SceneError, match=r"^m\.xml: .*gone\.png"):
        texture = '<texture name="t" type="2d" file="gone.png" embed="false"/><material name="m" texture="t"/>'
        load(tmp_path, texture, '<geom size="1" material="m"/>')


@pytest.mark.filterwarnings("error")
def test_what_mujoco_warns_of_is_not_python_s_to_tell(tmp_path):
    """Coordinates that an OBJ names and lacks; MuJoCo's compiler leaves them out."""
    vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\n"
    (tmp_path / "t.obj").write_text(vertices + "f 1/9 3/9 2/9\nf 1/9 2/9 4/9\nf 1/9 4/9 3/9\nf 2/9 3/9 4/9\n")
    assert load(tmp_path, '<mesh name="t" file="t.obj"/>', '<geom type="mesh" mesh="t"/>').instances[0].mesh.uv is None


def uv_at(mesh: Mesh, x: float, y: float, facing: int = 1) -> np.ndarray:
    """Texture coordinates where a line along z meets the side of the mesh that faces up (1) or down (-1)."""
    corners = mesh.vertices[mesh.faces].astype(float)
    a, b, c = (corners[:, i, :2] - (x, y) for i in range(3))
    weights = np.stack((_cross(b, c), _cross(c, a), _cross(a, b)))
    area = weights.sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        weights = weights / area
    hit = np.flatnonzero((weights >= -1e-9).all(axis=0) & (np.sign(area) == facing))[0]
    assert mesh.uv is not None
    return weights[:, hit] @ mesh.uv[hit].astype(float)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def on_edges(places: list[float], axis: int, mesh: Mesh) -> bool:
    """Whether u (or v) is a whole number of half periods of the checker there: its edges."""
    coordinates = [uv_at(mesh, *((p, 0.013) if axis == 0 else (0.013, p)))[axis] for p in places]
    return bool(np.abs(2 * np.array(coordinates) - np.round(2 * np.array(coordinates))).max() < 1e-3)


@pytest.mark.parametrize(
    ("size", "repeat", "uniform", "x_edges", "y_edges"),
    [
        ("0 0 1", "2 4", "false", [-0.5, 0, 0.5], [0.75, 0.5, 0.25, 0, -0.25]),
        ("0 0 1", "3 3", "true", [-2 / 3, -1 / 3, 0, 1 / 3, 2 / 3], [2 / 3, 1 / 3, 0]),
        ("1 0.5 1", "2 4", "false", [-0.5, 0, 0.5], [0.375, 0.25, 0.125, 0, -0.125]),
        ("1 0.5 1", "3 3", "false", [-2 / 3, -1 / 3, 0, 1 / 3], [1 / 3, 1 / 6, 0, -1 / 6]),
        ("1 0.5 1", "3 3", "true", [-2 / 3, -1 / 3, 0, 1 / 3], [1 / 6, -1 / 6]),
    ],
)
def test_checkers_on_a_plane_have_their_edges_where_mujoco_draws_them(
    tmp_path, size, repeat, uniform, x_edges, y_edges
):
    """Seen from above at 200 px per metre, in pictures of MuJoCo 4.0.0; between two edges next to each other there is
    none.
    """
    material = f'<material name="m" texture="t" texrepeat="{repeat}" texuniform="{uniform}"/>'
    mesh = load(tmp_path, CHECKER + material, f'<geom type="plane" size="{size}" material="m"/>').instances[0].mesh
    for axis, edges in enumerate((x_edges, y_edges)):
        assert on_edges(edges, axis, mesh)
        middles = [(a + b) / 2 for a, b in itertools.pairwise(edges)]
        assert not any(on_edges([middle], axis, mesh) for middle in middles)


PYRAMID = 'vertex="-1 -.5 0 1 -.5 0 1 .5 0 -1 .5 0 0 0 -.3" face="0 1 2 0 2 3 0 4 1 1 4 2 2 4 3 3 4 0"'
SHAPES = (
    f'<mesh name="q" {PYRAMID} texcoord="0 0 1 0 1 1 0 1 .5 .5"/><mesh name="p" {PYRAMID}/>'
    '<hfield name="h" nrow="2" ncol="2" size="1 .5 .1 .05" elevation="0 0 0 0"/>'
)
# fmt: off
MEASURED = [
    ('type="plane" size="1 .5 1"', '1.5 2.5', 'false', [
        ((0.3, 0.2, 0), (0, 0, 1), (0.975, 0.75)),
        ((-0.63, -0.17, 0), (0, 0, 1), (0.279, 0.674)),
    ]),
    ('type="plane" size="1 .5 1"', '1.5 2.5', 'true', [
        ((0.3, 0.2, 0), (0, 0, 1), (0.975, 0.375)),
        ((-0.63, -0.17, 0), (0, 0, 1), (0.279, 0.838)),
    ]),
    ('type="plane" size="0 0 1"', '1.5 2.5', 'false', [
        ((0.3, 0.2, 0), (0, 0, 1), (0.725, 0.25)),
        ((-0.63, -0.17, 0), (0, 0, 1), (0.029, 0.713)),
    ]),
    ('type="plane" size="0 0 1"', '1.5 2.5', 'true', [
        ((0.3, 0.2, 0), (0, 0, 1), (0.725, 0.25)),
        ((-0.63, -0.17, 0), (0, 0, 1), (0.029, 0.713)),
    ]),
    ('type="plane" size="0 .5 1"', '1.5 2.5', 'false', [
        ((0.3, 0.2, 0), (0, 0, 1), (0.725, 0.25)),
        ((-0.63, -0.17, 0), (0, 0, 1), (0.029, 0.174)),
    ]),
    ('type="plane" size="0 .5 1"', '1.5 2.5', 'true', [
        ((0.3, 0.2, 0), (0, 0, 1), (0.725, 0.875)),
        ((-0.63, -0.17, 0), (0, 0, 1), (0.029, 0.338)),
    ]),
    ('type="box" size=".4 .2 .3"', '1.5 2.5', 'false', [
        ((-0.4, 0.07, 0.2), (-1, 0, 0), (0.014, 0.416)),
        ((0.4, 0.07, 0.2), (1, 0, 0), (0.014, 0.416)),
        ((0.12, -0.2, 0.2), (0, -1, 0), (0.975, 0.416)),
        ((0.12, 0.2, 0.2), (0, 1, 0), (0.975, 0.416)),
        ((0.12, 0.07, -0.3), (0, 0, -1), (0.975, 0.813)),
        ((0.12, 0.07, 0.3), (0, 0, 1), (0.975, 0.813)),
    ]),
    ('type="box" size=".4 .2 .3"', '1.5 2.5', 'true', [
        ((-0.4, 0.07, 0.2), (-1, 0, 0), (0.404, 0.084)),
        ((0.4, 0.07, 0.2), (1, 0, 0), (0.404, 0.084)),
        ((0.12, -0.2, 0.2), (0, -1, 0), (0.389, 0.084)),
        ((0.12, 0.2, 0.2), (0, 1, 0), (0.389, 0.084)),
        ((0.12, 0.07, -0.3), (0, 0, -1), (0.389, 0.162)),
        ((0.12, 0.07, 0.3), (0, 0, 1), (0.389, 0.162)),
    ]),
    ('type="sphere" size=".5"', '1 1', 'false', [
        ((0.4192, 0.229, 0.1478), (0.8384, 0.458, 0.2955), (0.08, 0.404)),
        ((-0.1293, 0.2826, -0.3917), (-0.2587, 0.5652, -0.7833), (0.318, 0.787)),
        ((-0.0478, -0.2217, 0.4456), (-0.0956, -0.4434, 0.8912), (0.717, 0.15)),
        ((0.4705, -0.1369, -0.0993), (0.941, -0.2738, -0.1986), (0.955, 0.564)),
    ]),
    ('type="ellipsoid" size=".5 .3 .4"', '1 1', 'false', [
        ((0.4192, 0.1374, 0.1182), (0.7031, 0.6401, 0.3098), (0.08, 0.404)),
        ((-0.1293, 0.1696, -0.3133), (-0.187, 0.6811, -0.7079), (0.318, 0.787)),
        ((-0.0478, -0.133, 0.3565), (-0.0713, -0.5514, 0.8312), (0.717, 0.15)),
        ((0.4705, -0.0822, -0.0795), (0.8754, -0.4246, -0.231), (0.955, 0.564)),
    ]),
    ('type="cylinder" size=".3 .4"', '1 1', 'false', [
        ((0.2633, 0.1438, 0.1), (0.8776, 0.4794, 0), (0.08, 0.375)),
        ((-0.1248, 0.2728, -0.35), (-0.4161, 0.9093, 0), (0.318, 0.938)),
        ((0.2126, -0.2117, 0.3), (0.7087, -0.7055, 0), (0.877, 0.125)),
        ((0.1, 0.17, 0.4), (0, 0, 1), (0.666, 0.783)),
        ((0.1, 0.17, -0.4), (0, 0, -1), (0.666, 0.783)),
    ]),
    ('type="capsule" size=".3 .4"', '1 1', 'false', [
        ((0.2633, 0.1438, 0.1), (0.8776, 0.4794, 0), (0.08, 0.375)),
        ((-0.1248, 0.2728, -0.35), (-0.4161, 0.9093, 0), (0.318, 0.938)),
        ((0.2126, -0.2117, 0.3), (0.7087, -0.7055, 0), (0.877, 0.125)),
        ((0.2425, 0.1325, 0.5168), (0.8083, 0.4416, 0.3894), (0.08, 0.744)),
        ((-0.0889, -0.103, 0.6674), (-0.2965, -0.3433, 0.8912), (0.636, 0.299)),
        ((-0.103, 0.2251, -0.5694), (-0.3435, 0.7505, -0.5646), (0.318, 0.381)),
    ]),
    ('type="sphere" size=".5"', '1.5 2.5', 'true', [
        ((0.4192, 0.229, 0.1478), (0.8384, 0.458, 0.2955), (0.061, 0.506)),
        ((-0.1293, 0.2826, -0.3917), (-0.2587, 0.5652, -0.7833), (0.24, 0.982)),
        ((-0.0478, -0.2217, 0.4456), (-0.0956, -0.4434, 0.8912), (0.537, 0.186)),
        ((0.4705, -0.1369, -0.0993), (0.941, -0.2738, -0.1986), (0.717, 0.705)),
    ]),
    ('type="ellipsoid" size=".5 .3 .4"', '1.5 2.5', 'true', [
        ((0.4192, 0.1374, 0.1182), (0.7031, 0.6401, 0.3098), (0.061, 0.303)),
        ((-0.1293, 0.1696, -0.3133), (-0.187, 0.6811, -0.7079), (0.24, 0.589)),
        ((-0.0478, -0.133, 0.3565), (-0.0713, -0.5514, 0.8312), (0.537, 0.111)),
        ((0.4705, -0.0822, -0.0795), (0.8754, -0.4246, -0.231), (0.717, 0.424)),
    ]),
    ('type="cylinder" size=".3 .4"', '1.5 2.5', 'true', [
        ((0.2633, 0.1438, 0.1), (0.8776, 0.4794, 0), (0.037, 0.282)),
        ((-0.1248, 0.2728, -0.35), (-0.4161, 0.9093, 0), (0.143, 0.704)),
        ((0.2126, -0.2117, 0.3), (0.7087, -0.7055, 0), (0.393, 0.094)),
        ((0.1, 0.17, 0.4), (0, 0, 1), (0.299, 0.588)),
        ((0.1, 0.17, -0.4), (0, 0, -1), (0.299, 0.588)),
    ]),
    ('type="capsule" size=".3 .4"', '1.5 2.5', 'true', [
        ((0.2633, 0.1438, 0.1), (0.8776, 0.4794, 0), (0.037, 0.282)),
        ((-0.1248, 0.2728, -0.35), (-0.4161, 0.9093, 0), (0.143, 0.704)),
        ((0.2126, -0.2117, 0.3), (0.7087, -0.7055, 0), (0.393, 0.094)),
        ((0.2425, 0.1325, 0.5168), (0.8083, 0.4416, 0.3894), (0.037, 0.561)),
        ((-0.0889, -0.103, 0.6674), (-0.2965, -0.3433, 0.8912), (0.287, 0.225)),
        ((-0.103, 0.2251, -0.5694), (-0.3435, 0.7505, -0.5646), (0.143, 0.287)),
    ]),
    ('type="mesh" mesh="q"', '1.5 2.5', 'false', [
        ((0.3, 0.2, 0), (0, 0, 1), (0.975, 0.75)),
        ((-0.63, -0.17, 0), (0, 0, 1), (0.279, 0.826)),
    ]),
    ('type="mesh" mesh="q"', '1.5 2.5', 'true', [
        ((0.3, 0.2, 0), (0, 0, 1), (0.221, 0.875)),
        ((-0.63, -0.17, 0), (0, 0, 1), (0.061, 0.412)),
    ]),
    ('type="mesh" mesh="p"', '1.5 2.5', 'false', [
        ((0.33, 0.24, 0), (0, 0, 1), (0.752, 0.1)),
        ((-0.63, -0.17, 0), (0, 0, 1), (0.752, 0.076)),
    ]),
    ('type="mesh" mesh="p"', '1.5 2.5', 'true', [
        ((0.3, 0.2, 0), (0, 0, 1), (0.557, 0.75)),
        ((-0.63, -0.17, 0), (0, 0, 1), (0.557, 0.287)),
    ]),
    ('type="hfield" hfield="h"', '1.5 2.5', 'false', [
        ((0.33, 0.24, 0), (0, 0, 1), (0.748, 0.9)),
        ((-0.63, -0.17, 0), (0, 0, 1), (0.029, 0.924)),
    ]),
    ('type="hfield" hfield="h"', '1.5 2.5', 'true', [
        ((0.3, 0.2, 0), (0, 0, 1), (0.725, 0.25)),
        ((-0.63, -0.17, 0), (0, 0, 1), (0.029, 0.713)),
    ]),
]
"""geom, texrepeat, texuniform, and for places on it (in the world, with the direction outwards) the column and row of
the texture seen there, as fractions of its size from its upper left corner.

Measured in pictures of MuJoCo 4.0.0 (mujoco.Renderer, EGL) of a texture of 256 x 256 px, red its column and green its
row, under ambient light alone, 256 slices and 128 stacks, by a camera of 1 degree 0.05 m off: the mean of 25 pixels.
"""
# fmt: on


@pytest.mark.parametrize(("geom", "repeat", "uniform", "places"), MEASURED)
def test_a_2d_texture_lies_where_mujoco_lays_it(tmp_path, geom, repeat, uniform, places):
    """To two texels: half of one in MuJoCo's filter, and shapes of fewer faces here, most near the poles."""
    material = f'<material name="m" texture="t" texrepeat="{repeat}" texuniform="{uniform}"/>'
    instance = load(tmp_path, CHECKER + SHAPES + material, f'<geom {geom} material="m"/>').instances[0]
    corners = se3.transform(instance.pose, instance.mesh.vertices[instance.mesh.faces].astype(float))
    assert instance.mesh.uv is not None
    for place, out, column_and_row in places:
        face, weights = first_hit(corners, np.array(place) + 0.05 * np.array(out), -np.array(out))
        u, v = weights @ instance.mesh.uv[face].astype(float)
        off = np.array([u, 1 - v]) - column_and_row
        assert np.abs(off - np.round(off)).max() < 2 / 256, (place, off)


def first_hit(corners: np.ndarray, eye: np.ndarray, toward: np.ndarray) -> tuple[int, np.ndarray]:
    """The number of the first triangle that a ray meets, and the weights of its corners there."""
    a, b, c = (corners[:, k] for k in range(3))
    sides = np.stack((b - a, c - a, np.broadcast_to(-toward, a.shape)), axis=-1)
    faces = np.flatnonzero(np.abs(np.linalg.det(sides)) > 1e-12)
    second, third, distance = np.linalg.solve(sides[faces], (eye - a[faces])[..., None])[..., 0].T
    weights = np.stack((1 - second - third, second, third))
    met = np.flatnonzero((weights >= -1e-6).all(axis=0) & (distance > 0))
    first = met[np.argmin(distance[met])]
    return int(faces[first]), weights[:, first]


def test_one_picture_is_on_all_faces_of_a_cube(tmp_path):
    """A cube texture from a single square file: the whole picture on every side of a box."""
    rows = np.zeros((8, 8, 3), np.uint8)
    rows[:, :, 0], rows[:, :, 1] = np.arange(8) * 30, np.arange(8)[:, None] * 30
    Image.fromarray(rows).save(tmp_path / "p.png")
    asset = '<texture name="t" type="cube" file="p.png"/><material name="m" texture="t"/>'
    scene = load(tmp_path, asset, '<geom type="box" size="1 2 3" material="m"/>')
    texture, uv = scene.materials[0].texture, scene.instances[0].mesh.uv
    assert texture is not None and texture.shape == (48, 8, 3) and uv is not None
    assert all(np.array_equal(texture[:8], texture[8 * k : 8 * k + 8]) for k in range(6))
    faces = np.floor((1 - uv[..., 1].mean(axis=1)) * 6)
    for face in range(6):
        part = uv[faces == face].reshape(-1, 2)
        assert np.ptp(part[:, 0]) > 0.8 and np.ptp(part[:, 1]) > 0.8 / 6


def test_a_cube_texture_is_uniform_where_it_says(tmp_path):
    """texuniform: by the direction in metres. The ends of a beam are then a small part of their faces."""
    asset = '<texture name="t" type="cube" builtin="flat" width="64" height="384"/>'
    asset += '<material name="m" texture="t" texuniform="{}"/>'
    wide = {}
    for uniform in ("true", "false"):
        scene = load(tmp_path, asset.format(uniform), '<geom type="box" size="4 1 1" material="m"/>')
        uv, mesh = scene.instances[0].mesh.uv, scene.instances[0].mesh
        assert uv is not None
        end = np.abs(mesh.vertices[mesh.faces][..., 0]).min(axis=1) > 3.9  # the sides at x = +-4
        wide[uniform] = np.ptp(uv[end][..., 0])
    assert np.isclose(wide["false"], 1 - 1 / 64, atol=1e-3) and np.isclose(wide["true"], 0.25, atol=1e-3)


@pytest.mark.parametrize(
    "shape, area",
    [
        ('type="box" size="4 1 0.3"', 8 * (4 * 1 + 4 * 0.3 + 1 * 0.3)),
        ('type="cylinder" size="1 0.2"', 2.8 * np.pi),
        ('type="capsule" size="0.3 0.9"', 1.44 * np.pi),
    ],
)
def test_a_cube_texture_bends_at_its_edges(tmp_path, shape, area):
    """Points all over the triangles have the texel of their direction, by OpenGL's table of faces. MuJoCo stretches the
    caps of a capsule by half-length over radius, away from its sides, and looks up in what that makes of them.
    """
    asset = '<texture name="t" type="cube" builtin="flat" width="1024" height="6144"/>'
    asset += '<material name="m" texture="t" texuniform="true"/>'
    mesh = load(tmp_path, asset, f'<geom {shape} material="m"/>').instances[0].mesh
    random = np.random.Generator(np.random.Philox(5))
    corners, uv = mesh.vertices[mesh.faces].astype(float), mesh.uv.astype(float)
    share = random.dirichlet([1, 1, 1], (40, len(corners)))
    points = np.einsum("nfk,fkx->nfx", share, corners).reshape(-1, 3)
    u, v = np.einsum("nfk,fkx->nfx", share, uv).reshape(-1, 2).T
    if "capsule" in shape:
        points[:, 2] += np.sign(points[:, 2]) * np.maximum(np.abs(points[:, 2]) - 0.9, 0) * (0.9 / 0.3 - 1)
    axis = np.abs(points).argmax(axis=1)
    m = np.take_along_axis(points, axis[:, None], axis=1)[:, 0]
    x, y, z = points.T
    sc = np.select([axis == 0, axis == 1, axis == 2], [-np.sign(m) * z, x, np.sign(m) * x])
    tc = np.select([axis == 0, axis == 1, axis == 2], [-y, np.sign(m) * z, -y])
    below = 6 * (1 - v) - (2 * axis + (m < 0))
    assert np.abs(u - 0.5 * (sc / np.abs(m) + 1)).max() < 0.015
    assert np.abs(below - 0.5 * (tc / np.abs(m) + 1)).max() < 0.015
    found = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    assert np.isclose(found, area, rtol=0.01)
    assert len(corners) < 6000


FACES = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (0, 1, 1), (1, 0, 1)]


def test_the_skybox_is_seen_where_mujoco_draws_it_and_lights_nothing(tmp_path):
    """Right, left, up, down, front and back of the texture are +x, -x, +z, -z, -y and +y of the world."""
    names = ("right", "left", "up", "down", "front", "back")
    for name, colour in zip(names, FACES):
        Image.fromarray(np.full((16, 16, 3), np.array(colour) * 255, np.uint8)).save(tmp_path / f"{name}.png")
    files = " ".join(f'file{name}="{name}.png"' for name in names)
    scene = load(tmp_path, f'<texture type="skybox" {files}/>', '<geom size="1"/>')
    sky = scene.environment_map
    assert sky is not None and not scene.sky_lights and np.allclose(scene.environment, 0.1)
    rows = sky.shape[0]
    places = [(0.5, 0), (0.5, 0.5), (0, 0), (1, 0), (0.5, 0.75), (0.5, 0.25)]
    for name, colour, (v, u) in zip(names, FACES, places):
        assert sky[min(int(v * rows), rows - 1), int(u * 2 * rows)].tolist() == list(colour), name


def test_a_scene_s_own_sky_is_in_place_of_the_skybox(tmp_path):
    """Its `environment` is seen and lights."""
    load(tmp_path, '<texture type="skybox" builtin="flat" rgb1="1 0 0" width="8" height="48"/>', '<geom size="1"/>')
    (tmp_path / "s.yaml").write_text("mjcf: m.xml\nenvironment: 0.5\n")
    scene = load_scene(str(tmp_path / "s.yaml"))
    assert scene.environment_map is None and scene.sky_lights and np.allclose(scene.environment, 0.5)
