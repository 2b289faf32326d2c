"""OBJ, PLY, STL and glTF files: geometry, materials and what a bad file says."""

import json
import struct

import numpy as np
import pytest
import trimesh
from PIL import Image

from evis.scene import SceneError, load_scene
from evis.scene.mesh.normals import crease_normals

TEXELS = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 128], [188, 188, 188]]], np.uint8)
UV = np.array([[0.25, 0.75], [0.75, 0.75], [0.25, 0.25], [0.75, 0.25]])
"""Centres of the four texels, row by row from the top left."""


@pytest.fixture
def load(tmp_path):
    def load(entry, head="materials: {m: {}}\n", **options):
        text = f"cameras: {{cam0: {{fov: 1}}}}\n{head}world:\n  - {{name: thing, shape: mesh, {entry}}}\n"
        (tmp_path / "s.yaml").write_text(text)
        return load_scene(str(tmp_path / "s.yaml"), **options)

    return load


def test_obj_with_its_material(load, tmp_path):
    """Positions, faces, uv (v upwards) and Kd (sRGB) as the text of the file says."""
    (tmp_path / "quad.mtl").write_text("newmtl paint\nKd 0.5 0.0 1.0\n")
    (tmp_path / "quad.obj").write_text(
        "mtllib quad.mtl\nusemtl paint\nv 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\n"
        "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n"
    )
    scene = load("file: quad.obj, scale: [1, 2, 1]")
    (instance,) = scene.instances
    mesh = instance.mesh
    corners = mesh.vertices[mesh.faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert len(mesh.faces) == 2 and np.isclose(0.5 * np.linalg.norm(area, axis=-1).sum(), 4) and (area[:, 2] > 0).all()
    assert np.allclose(mesh.uv, corners[..., :2] / [2, 2]) and np.allclose(mesh.normals, [0, 0, 1])
    assert np.allclose(scene.materials[instance.material].albedo, [0.21404, 0, 1], atol=1e-5)
    assert scene.materials[instance.material].name == "quad_paint"
    assert load("file: quad.obj, material: m").instances[0].material == 0


@pytest.mark.parametrize("suffix", ["ply", "stl"])
def test_formats_without_material_need_one(load, tmp_path, suffix):
    """The box that trimesh wrote comes back; without a material the file is named."""
    box = trimesh.creation.box((1.0, 2.0, 3.0))
    box.visual = trimesh.visual.ColorVisuals()
    box.export(tmp_path / f"box.{suffix}")
    mesh = load(f"file: box.{suffix}, material: m, scale: 0.001").instances[0].mesh
    assert len(mesh.faces) == 12 and np.allclose(np.ptp(mesh.vertices, axis=0), [1e-3, 2e-3, 3e-3])
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces].astype(np.float64), 1, 0)
    assert np.isclose(np.sum(a * np.cross(b, c)) / 6, 6e-9, rtol=1e-5)
    with pytest.raises(SceneError, match=rf"s\.yaml:4: .*box\.{suffix}, which has no material; add 'material'"):
        load(f"file: box.{suffix}")


@pytest.fixture
def gltf(tmp_path):
    """Two nodes of one textured quad, one of them mirrored, in glTF's own axes (y up)."""
    material = trimesh.visual.material.PBRMaterial(
        name="glow", baseColorFactor=[1.0, 1.0, 1.0, 1.0], metallicFactor=0.25, roughnessFactor=0.375,
        emissiveFactor=[0.5, 0.25, 0.0], baseColorTexture=Image.fromarray(TEXELS), doubleSided=True,
    )  # fmt: skip
    points = np.array([[0.0, 1, 0], [1, 1, 0], [0, 0, 0], [1, 0, 0]])
    quad = trimesh.Trimesh(points, [[0, 2, 1], [1, 2, 3]], process=False)
    quad.visual = trimesh.visual.TextureVisuals(uv=UV, material=material)
    scene = trimesh.Scene()
    shift = trimesh.transformations.translation_matrix([0, 0, 2])
    scene.add_geometry(quad, geom_name="quad", node_name="a", transform=shift)
    scene.graph.update(frame_to="b", geometry="quad", matrix=np.diag([-1.0, 1, 1, 1]))
    scene.export(tmp_path / "quad.glb")
    # What a file may say but trimesh does not write: a dark factor that 8 bits would round, and a strong emission.
    data = (tmp_path / "quad.glb").read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    tree = json.loads(data[20 : 20 + length])
    tree["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [0.021, 0.5, 1.0, 1.0]
    tree["materials"][0]["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": 8.0}}
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    body = struct.pack("<I4s", len(text), b"JSON") + text + rest
    (tmp_path / "quad.glb").write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
    return "file: quad.glb"


def test_gltf_materials_are_metallic_roughness(load, gltf):
    """Factor linear and exact, texture from sRGB, emission times its strength; one material for both nodes."""
    scene = load(gltf, head="")
    (material,) = scene.materials
    assert np.allclose(material.albedo, [0.021, 0.5, 1.0], rtol=1e-6)
    assert (material.metallic, material.roughness, material.two_sided) == (0.25, 0.375, True)
    assert np.allclose(material.emission, [4, 2, 0])
    # sRGB 188 is linear 0.5029, 128 is 0.2159
    assert np.allclose(material.texture[1], [[0, 0, 0.2159], [0.5029] * 3], atol=1e-4)
    assert np.allclose(material.texture[0], [[1, 0, 0], [0, 1, 0]])
    assert load(gltf, head="", textures=False).materials[0].texture is None


def test_gltf_materials_may_share_a_name(load, tmp_path):
    """Written by hand, as trimesh would rename them: two squares, a dark red one and a green one, both `paint`."""
    points = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], "<f4").tobytes()
    data = points + np.array([0, 1, 2, 0, 2, 3], "<u2").tobytes()
    colours = [[0.021, 0.0, 0.0, 1.0], [0.0, 0.9, 0.0, 1.0]]
    pbr = [{"name": "paint", "pbrMetallicRoughness": {"baseColorFactor": c, "metallicFactor": 0}} for c in colours]
    meshes = [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": k}]} for k in range(2)]
    limits = {"min": [0, 0, 0], "max": [1, 1, 0]}
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}], "meshes": meshes, "materials": pbr,
        "nodes": [{"mesh": 0, "name": "a"}, {"mesh": 1, "name": "b"}], "buffers": [{"byteLength": 60}],
        "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 12}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", **limits},
                      {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"}],
    }  # fmt: skip
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    (tmp_path / "two.glb").write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
    scene = load("file: two.glb", head="")
    seen = [scene.materials[instance.material] for instance in scene.instances]
    np.testing.assert_allclose([material.albedo for material in seen], np.array(colours)[:, :3], atol=1e-7)
    assert len({material.name for material in seen}) == 2


def test_gltf_nodes_stand_z_up_and_face_the_same_way(load, gltf):
    """y up becomes z up, the node's transform counts, a mirrored node is not inside out, uv stay at their corners."""
    scene = load(gltf, head="")
    assert [i.name for i in scene.instances] == ["thing_0", "thing_1"]
    for instance, low, high in zip(scene.instances, ([0, -2, 0], [-1, 0, 0]), ([1, -2, 1], [0, 0, 1])):
        mesh = instance.mesh
        corners = mesh.vertices[mesh.faces].astype(np.float64)
        assert np.allclose(corners.min((0, 1)), low) and np.allclose(corners.max((0, 1)), high)
        assert np.allclose(mesh.normals, [0, -1, 0]), "glTF's +z is -y here"
        across = corners[..., 0] if low[0] == 0 else -corners[..., 0]
        assert np.allclose(mesh.uv, 0.25 + 0.5 * np.stack((across, corners[..., 2]), axis=-1))
    flat = load(gltf + ", up: z", head="").instances[0].mesh.vertices
    assert np.allclose(flat[:, 2], 2)


def test_creases():
    """Of a closed prism with 24 sides: round along the side, sharp at the caps; flat everywhere with crease 0."""
    mesh = trimesh.creation.cylinder(radius=1.0, height=2.0, sections=24)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    normals = crease_normals(vertices, faces, np.radians(40)).astype(np.float64)
    corners = vertices[faces]
    side = np.abs(mesh.face_normals[:, 2]) < 0.5
    radial = corners[side] * [1, 1, 0]
    assert np.abs(normals[side] - radial / np.linalg.norm(radial, axis=-1, keepdims=True)).max() < 0.05
    assert np.abs(normals[~side] - mesh.face_normals[~side][:, None]).max() < 1e-6
    flat = crease_normals(vertices, faces, 0.0)
    assert np.abs(flat - np.asarray(mesh.face_normals)[:, None]).max() < 1e-6


def fan(count, height):
    """A cone's side, or a disc, of `count` triangles around one vertex."""
    angle = 2 * np.pi * np.arange(count) / count
    rim = np.stack((np.cos(angle), np.sin(angle), 0 * angle), axis=-1)
    k = np.arange(count)
    return np.concatenate(([[0.0, 0.0, height]], rim)), np.stack((0 * k, k + 1, (k + 1) % count + 1), axis=-1)


def test_many_faces_may_meet_at_a_vertex():
    """A disc of 100,000 triangles is flat; at a cone's tip the normals within the crease are summed, in closed form."""
    vertices, faces = fan(100_000, 0.0)
    np.testing.assert_allclose(crease_normals(vertices, faces, 0.7), np.broadcast_to([0, 0, 1.0], (100_000, 3, 3)))
    vertices, faces = fan(3000, 1.0)
    normals = crease_normals(vertices, faces, np.radians(40))[:, 0]
    reach = np.arccos((np.cos(np.radians(40)) - 0.5) / 0.5)  # in azimuth, of sides at 45 degrees
    tip = np.array([np.sin(reach), 0.0, reach]) / np.hypot(np.sin(reach), reach)
    np.testing.assert_allclose(normals[0], tip, atol=2e-3)
    np.testing.assert_allclose(normals[:, 2], tip[2], atol=2e-3)


@pytest.mark.parametrize(
    "name, content, words",
    [
        ("gone.obj", None, r"names gone\.obj, which is not in"),
        ("x.dae", b"<COLLADA/>", r"x\.dae is of no kind that can be read; there are \.obj"),
        ("x.glb", b"glTF\x02\x00\x00\x00\xff\xff\xff\xff", r"x\.glb cannot be read as GLB"),
        ("x.gltf", b"{", r"x\.gltf cannot be read as GLTF"),
        ("x.ply", b"ply\nformat ascii 1.0\nelement vertex 3\n", r"x\.ply"),
        (
            "x.ply",
            b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
            b"element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 0 1\n3 0 1 -1\n",
            r"x\.ply has a face with vertex -1; its 3 are numbered from 0",
        ),
        ("x.stl", b"", r"x\.stl"),
        ("x.obj", b"v 0 0 0\n", r"x\.obj"),
        ("x.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", r"x\.obj has 1 vertices that are not finite"),
    ],
)
def test_bad_files_are_one_line(load, tmp_path, name, content, words):
    """Missing, of a wrong kind, cut off, empty, with NaN."""
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(SceneError, match=words) as caught:
        load(f"file: {name}, material: m")
    assert "s.yaml:4" in str(caught.value) and "\n" not in str(caught.value)


def test_those_who_need_no_visuals_read_no_file(load, tmp_path):
    """Bodies and cameras alone: a mesh that is not there does not matter, and nothing to see is made."""
    scene = load("file: gone.obj", visuals=False)
    assert not scene.instances and not scene.materials and [b.name for b in scene.bodies] == ["cam0"]


def test_image_textures(tmp_path):
    """A picture as a texture, from sRGB; one that is none is an error."""
    Image.fromarray(TEXELS).save(tmp_path / "t.png")
    (tmp_path / "no.png").write_bytes(b"no picture")
    text = "cameras: {cam0: {fov: 1}}\nmaterials: {m: {texture: {kind: image, file: t.png}}}\n"
    (tmp_path / "s.yaml").write_text(text)
    texture = load_scene(str(tmp_path / "s.yaml")).materials[0].texture
    assert texture.shape == (2, 2, 3) and texture[0, 0].tolist() == [1, 0, 0]
    assert np.allclose(texture[1, 1], 0.5029, atol=1e-4)
    for name, words in (("no.png", "which is no picture"), ("gone.png", "which is not in")):
        (tmp_path / "s.yaml").write_text(text.replace("t.png", name))
        with pytest.raises(SceneError, match=rf"s\.yaml:2: .*file names {name}, {words}"):
            load_scene(str(tmp_path / "s.yaml"))


def test_a_mesh_in_coordinates_of_a_map_keeps_its_shape(load, tmp_path):
    """A decimetre in UTM, where float32 counts in half metres; its place is the instance's, which is float64."""
    near = np.array([[0.1, 0.2, 100.3], [0.2, 0.2, 100.3], [0.1, 0.3, 100.3], [0.2, 0.3, 100.35]])
    corners = near + np.array([5e5, 5.4e6, 0])
    text = "".join("v {:.4f} {:.4f} {:.4f}\n".format(*corner) for corner in corners)
    (tmp_path / "map.obj").write_text(text + "f 1 2 3\nf 2 4 3\n")
    (instance,) = load("file: map.obj, material: m, position: [-5.0e+5, -5.4e+6, 0]").instances
    vertices = instance.mesh.vertices[instance.mesh.faces].astype(np.float64) + instance.pose[:3]
    assert np.abs(vertices - near[[[0, 1, 2], [1, 3, 2]]]).max() < 1e-7
