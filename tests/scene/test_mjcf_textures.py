"""Textures of a MuJoCo model lie as MuJoCo's renderer lays them: places of edges measured in its pictures."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from evis.scene import SceneError, load_scene
from evis.scene.folders import Folders
from evis.scene.mjcf.compile import compile_drawn
from evis.scene.model import Mesh, Scene

mujoco = pytest.importorskip("mujoco")

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
        ("1 0.5 1", "3 3", "true", [-2 / 3, -1 / 3, 0, 1 / 3], [1 / 3, 0, -1 / 3]),
    ],
)
def test_checkers_on_a_plane_have_their_edges_where_mujoco_draws_them(
    tmp_path, size, repeat, uniform, x_edges, y_edges
):
    """Seen from above at 100 px per metre; between two edges next to each other there is none."""
    material = f'<material name="m" texture="t" texrepeat="{repeat}" texuniform="{uniform}"/>'
    mesh = load(tmp_path, CHECKER + material, f'<geom type="plane" size="{size}" material="m"/>').instances[0].mesh
    for axis, edges in enumerate((x_edges, y_edges)):
        assert on_edges(edges, axis, mesh)
        middles = [(a + b) / 2 for a, b in itertools.pairwise(edges)]
        assert not any(on_edges([middle], axis, mesh) for middle in middles)


def test_a_2d_texture_lies_on_the_upper_side_of_a_primitive(tmp_path):
    """Projected along z, its middle in the middle, texrepeat times over the whole."""
    material = '<material name="m" texture="t" texrepeat="2 1"/>'
    for geom in ('type="box" size="0.5 0.25 0.1"', 'type="ellipsoid" size="0.5 0.25 0.1"'):
        mesh = load(tmp_path, CHECKER + material, f'<geom {geom} material="m"/>').instances[0].mesh
        assert np.allclose(uv_at(mesh, 0.0, 0.0), [0.5, 0.5], atol=1e-6)
        assert np.allclose(uv_at(mesh, 0.125, 0.0625), [0.75, 0.625], atol=1e-6)


def test_coordinates_of_a_mesh_s_own_are_not_repeated(tmp_path):
    """texrepeat is for textures that are projected."""
    mesh = '<mesh name="s" vertex="0 0 0 1 0 0 0 1 0 0 0 1" texcoord="0 0 1 0 0 1 0.25 0.75"/>'
    material = '<material name="m" texture="t" texrepeat="5 7"/>'
    scene = load(tmp_path, CHECKER + material + mesh, '<geom type="mesh" mesh="s" material="m"/>')
    uv = scene.instances[0].mesh.uv
    assert uv is not None and uv.min() >= 0 and uv.max() <= 1


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
