"""A folder of pictures or meshes in the place of what code makes: drawn by the seed, told by name, or refused."""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import trimesh
from PIL import Image

from evis.scene import load_scene
from evis.scene.errors import SceneError
from evis.scene.load import drawn_places, folder_args
from evis.scene.mesh.files import load_parts
from evis.scene.parameters import scene_of

SCENE = """\
args: {textures: {type: folder, default: "", help: pictures}, meshes: {type: folder, default: "", help: meshes}}
cameras: {cam0: {position: [0, -2, 0], look_at: [0, 0, 0], fov: 60 deg}}
materials: {skin: {texture: {kind: noise, size: 16, folder: "${textures}"}}}
bodies:
  thing: {position: [1, 0, 0], shapes: [{shape: box, size: [0.4, 0.2, 0.1], material: skin, folder: "${meshes}"}]}
environment: 1
"""
COLOURS = {"a.png": (255, 0, 0), "b.jpg": (0, 0, 255), "c.tif": (0, 255, 0)}


@pytest.fixture
def scene(tmp_path: Path) -> str:
    """The scene, beside a folder of three pictures of one colour each and one of two meshes."""
    (tmp_path / "pictures").mkdir()
    (tmp_path / "meshes").mkdir()
    for name, colour in COLOURS.items():
        Image.new("RGB", (40, 20), colour).save(tmp_path / "pictures" / name, quality=95)
    (tmp_path / "pictures" / "README.txt").write_text("not a picture, and left alone")
    trimesh.creation.box([20, 10, 10]).export(tmp_path / "meshes" / "block.stl")
    trimesh.creation.icosphere(2, 3.0).apply_translation([7, 0, 0]).export(tmp_path / "meshes" / "round.obj")
    (tmp_path / "s.yaml").write_text(SCENE)
    return str(tmp_path / "s.yaml")


def test_pictures_are_drawn_by_the_seed_and_told_by_name(scene: str, tmp_path: Path) -> None:
    given = {"textures": str(tmp_path / "pictures")}
    found = {}
    for seed in range(24):
        world = load_scene(scene, given, seed=seed)
        (drawn,) = world.drawn
        assert drawn.place == "materials.skin.texture.folder"
        texture = world.materials[0].texture
        assert texture is not None and texture.shape == (8, 16, 3)  # no longer than `size`
        assert np.allclose(texture, np.array(COLOURS[drawn.value]) / 255, atol=0.02)
        found[seed] = drawn.value
        assert load_scene(scene, given, seed=seed).drawn[0].value == drawn.value
    assert set(found.values()) == set(COLOURS)
    assert drawn_places(scene, given) == ["materials.skin.texture.folder"] and drawn_places(scene, {}) == []
    assert folder_args(scene) == ["textures", "meshes"]


def test_without_a_folder_nothing_is_drawn(scene: str) -> None:
    assert load_scene(scene, {"textures": "", "meshes": ""}).drawn == []


def test_a_mesh_lies_in_the_box_of_the_shape_whose_place_it_takes(scene: str, tmp_path: Path) -> None:
    """Its middle and its longest side are those of the box; without texture coordinates it gets some."""
    names = set()
    for seed in range(8):
        world = load_scene(scene, {"meshes": str(tmp_path / "meshes")}, seed=seed)
        (instance,), (drawn,) = world.instances, world.drawn
        names.add(drawn.value)
        low, high = instance.mesh.vertices.min(0), instance.mesh.vertices.max(0)
        assert np.allclose(0.5 * (low + high), 0, atol=1e-6) and np.isclose((high - low).max(), 0.4)
        assert instance.mesh.uv is not None and instance.mesh.uv.min() >= 0 and instance.mesh.uv.max() <= 1
        assert world.materials[instance.material].name == "skin" and instance.name == "thing"
        if drawn.value == "block.stl":
            assert np.allclose(high - low, [0.4, 0.2, 0.2])
    assert names == {"block.stl", "round.obj"}


def test_a_mesh_with_a_material_keeps_it(scene: str, tmp_path: Path) -> None:
    red = trimesh.visual.material.PBRMaterial(name="red", baseColorFactor=[255, 0, 0, 255])
    part = trimesh.creation.box([1, 1, 2])
    part.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(part.vertices), 2)), material=red)
    plain = trimesh.creation.box([1, 1, 1]).apply_translation([0, 0, 3])
    (tmp_path / "two").mkdir()
    trimesh.Scene({"a": part, "b": plain}).export(tmp_path / "two" / "two.glb")
    world = load_scene(scene, {"meshes": str(tmp_path / "two")})
    used = [world.materials[i.material] for i in world.instances]
    assert [i.name for i in world.instances] == ["thing_0", "thing_1"]
    assert {tuple(m.albedo) for m in used if m.name != "skin"} == {(1.0, 0.0, 0.0)}


def test_sixteen_bits_and_exr(scene: str, tmp_path: Path) -> None:
    """Half of 16 bits is sRGB's 0.5; EXR is linear, and reflects no more than all light."""
    for name in ("grey", "exr", "bright"):
        (tmp_path / name).mkdir()
    Image.fromarray(np.full((4, 4), 32768, np.uint16)).save(tmp_path / "grey" / "g.png")
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    for name, value in (("exr", 0.25), ("bright", 3.0)):
        pixels = np.full((4, 4, 3), value, np.float32)
        OpenEXR.File(header, {"RGB": pixels}).write(str(tmp_path / name / "p.exr"))
    for name, value in (("grey", ((0.5 + 0.055) / 1.055) ** 2.4), ("exr", 0.25)):
        assert np.allclose(load_scene(scene, {"textures": str(tmp_path / name)}).materials[0].texture, value, atol=1e-4)
    with pytest.raises(SceneError, match=r"p\.exr has texels up to 3; .*scale it down"):
        load_scene(scene, {"textures": str(tmp_path / "bright")})


@pytest.mark.parametrize(("kind", "channels"), [(2, 3), (6, 4), (4, 2)])
def test_all_bits_of_sixteen_count_of_colours_too(scene: str, tmp_path: Path, kind: int, channels: int) -> None:
    """Of RGB, RGBA and grey with alpha; the PNG is written by its specification, darker than 8 bits can tell."""
    codes = np.random.Generator(np.random.Philox(1)).integers(1, 600, (4, 4, channels), np.uint16)

    def chunk(name: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))

    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in codes)
    head = struct.pack(">IIBBBBB", 4, 4, 16, kind, 0, 0, 0)
    png = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "d.png").write_bytes(png)
    (tmp_path / "m.mtl").write_text("newmtl m\nmap_Kd deep/d.png\n")
    (tmp_path / "m.obj").write_text("mtllib m.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n")
    expected = codes[..., :3] if channels > 2 else codes[..., :1]
    texture = load_scene(scene, {"textures": str(tmp_path / "deep")}).materials[0].texture
    assert np.allclose(texture, expected / 65535 / 12.92, rtol=1e-5, atol=0)
    (part,) = load_parts(tmp_path / "m.obj", np.ones(3))
    assert part.material is not None and np.array_equal(part.material.texture, texture)


def test_what_cannot_be_used_is_one_line(scene: str, tmp_path: Path) -> None:
    """It names the file and what to do."""
    (tmp_path / "empty" / "folder.png").mkdir(parents=True)
    bad = {"text": ("t.png", b"hello"), "cut": ("c.stl", b"solid x"), "line": ("l.obj", b"v 0 0 0\nv 1 0 0\nl 1 2\n")}
    for folder, (name, data) in bad.items():
        (tmp_path / folder).mkdir()
        (tmp_path / folder / name).write_bytes(data)
    flat = trimesh.Trimesh([[1, 1, 1]] * 3, [[0, 1, 2]], process=False)
    (tmp_path / "point").mkdir()
    flat.export(tmp_path / "point" / "p.ply")
    for key, folder, words in (
        ("textures", "empty", "holds no picture: none of its files ends in .png"),
        ("textures", "gone", "is not there; name a folder of pictures"),
        ("textures", "s.yaml", "is no folder; name a folder of pictures"),
        ("textures", "text", "t.png is no picture: .*; mend it or take it away"),
        ("meshes", "empty", "holds no mesh"),
        ("meshes", "cut", "c.stl .*; mend it or take it away"),
        ("meshes", "line", "l.obj has no triangles; mend"),
        ("meshes", "point", "p.ply has no triangle with an area"),
    ):
        with pytest.raises(SceneError, match=words) as caught:
            load_scene(scene, {key: str(tmp_path / folder)})
        assert str(caught.value).count("\n") == 0 and "s.yaml:" in str(caught.value)


def test_a_picture_of_hostile_size_is_refused_by_its_header(scene: str, tmp_path: Path) -> None:
    import struct
    import zlib

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    (tmp_path / "huge").mkdir()
    header = struct.pack(">IIBBBBB", 60000, 60000, 8, 2, 0, 0, 0)
    (tmp_path / "huge" / "h.png").write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IEND", b""))
    with pytest.raises(SceneError, match=r"h\.png is of more than \d+ texels, .*take it away"):
        load_scene(scene, {"textures": str(tmp_path / "huge")})


def test_a_file_that_comes_or_changes_makes_another_scene(scene: str, tmp_path: Path) -> None:
    """Nodes of a process share a scene only while the folder is as it was."""
    params = {"scene": scene, "scene_args": f"textures={tmp_path / 'pictures'}"}
    first = scene_of("renderer", params)
    assert scene_of("interpolator", params) is first
    Image.new("RGB", (4, 4)).save(tmp_path / "pictures" / "d.png")
    os.utime(tmp_path / "pictures", ns=(0, 1))
    assert scene_of("renderer", params) is not first
