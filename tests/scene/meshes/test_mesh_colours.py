"""Colours of vertices and faces in PLY, OBJ and glTF files: exact, as sRGB or linear as the format has it."""

import json
import struct

import numpy as np
import pytest

from evis.scene import SceneError
from evis.scene.images.colour import linear_from_codes
from evis.scene.mesh.files import load_parts

COLOURS = np.array([(1, 0, 0), (0, 0.5, 0.003), (16 / 255, 0, 1)])
"""Of the three vertices of a triangle; 0.003 is less than an 8-bit step, 16 / 255 little more than sRGB's knee."""
ONE = np.ones(3)


def from_srgb(value):
    """IEC 61966-2-1."""
    value = np.asarray(value, np.float64)
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def ply(kind, rows, of="vertex"):
    names = ("red", "green", "blue", "alpha")[: len(rows[0])]
    properties = [f"property {kind} {name}" for name in names]
    lines = ["ply", "format ascii 1.0", "element vertex 3", *(f"property float {axis}" for axis in "xyz")]
    lines += properties if of == "vertex" else []
    lines += ["element face 1", "property list uchar int vertex_indices", *(properties if of == "face" else [])]
    texts = [" ".join(str(v) for v in row) for row in rows]
    points = ["0 0 0", "1 0 0", "0 1 0"]
    if of == "vertex":
        points = [f"{point} {text}" for point, text in zip(points, texts)]
    face = "3 0 1 2" + (f" {texts[0]}" if of == "face" else "")
    return "\n".join([*lines, "end_header", *points, face, ""])


def glb(colours, component, material):
    """A triangle in glTF's own axes with COLOR_0 of this type of component."""
    data = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32).tobytes()
    data += np.array([0, 1, 2, 0], np.uint16).tobytes() + colours.tobytes()
    data += b"\0" * (-len(data) % 4)
    primitive = {"attributes": {"POSITION": 0, "COLOR_0": 2}, "indices": 1, **({"material": 0} if material else {})}
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [{"name": "paint", "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 1, 1]}}],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 6},
                        {"buffer": 0, "byteOffset": 44, "byteLength": colours.nbytes}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0],
                       "max": [1, 1, 0]},
                      {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"},
                      {"bufferView": 2, "componentType": component, "count": 3, "type": f"VEC{colours.shape[1]}",
                       "normalized": component != 5126}],
    }  # fmt: skip
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def only(path, **options):
    (part,) = load_parts(path, ONE, **options)
    return part


@pytest.mark.parametrize("kind, largest", [("uchar", 255), ("ushort", 65535), ("float", 1.0)])
@pytest.mark.parametrize("alpha", [True, False])
def test_ply_vertices(tmp_path, kind, largest, alpha):
    """sRGB, whole numbers over the largest of their type; alpha does nothing; no material is a white one."""
    rows = np.concatenate([COLOURS, [[0.5]] * 3], 1)[:, : 4 if alpha else 3] * largest
    rows = rows if kind == "float" else np.round(rows).astype(int)
    (tmp_path / "x.ply").write_text(ply(kind, rows.tolist()))
    part = only(tmp_path / "x.ply")
    expected = from_srgb(rows[:, :3] / largest)
    np.testing.assert_allclose(part.mesh.colours, expected[part.mesh.faces], atol=1e-6)
    assert part.mesh.colours.dtype == np.float32 and part.material.name == "x_white"
    assert part.material.albedo.tolist() == [1, 1, 1] and part.material.roughness == 1
    bare = only(tmp_path / "x.ply", textures=False)
    assert bare.mesh.colours is None


def test_a_dark_code_by_hand():
    """((16 / 255 + 0.055) / 1.055)^2.4 and 8 / 255 / 12.92."""
    assert np.allclose(linear_from_codes(np.array([16, 8], np.uint8)), [0.0051815, 0.0024282], rtol=1e-4)


def test_ply_faces(tmp_path):
    """All corners of a face have its colour."""
    (tmp_path / "x.ply").write_text(ply("uchar", [[255, 128, 0]], "face"))
    colours = only(tmp_path / "x.ply").mesh.colours
    np.testing.assert_allclose(colours, np.tile(from_srgb(np.array([255, 128, 0]) / 255), (1, 3, 1)), atol=1e-6)


@pytest.mark.parametrize("material", [True, False])
def test_obj(tmp_path, material):
    """v x y z r g b, sRGB; beside a material of the file they stay, and it stays."""
    (tmp_path / "x.mtl").write_text("newmtl paint\nKd 0.5 0.5 0.5\n")
    lines = ["mtllib x.mtl", "usemtl paint"] if material else []
    for (x, y), (r, g, b) in zip(((0, 0), (1, 0), (0, 1)), COLOURS):
        lines.append(f"v {x} {y} 0 {r} {g} {b}")
    lines += ["vt 0 0", "vt 1 0", "vt 0 1", "f 1/1 2/2 3/3"] if material else ["f 1 2 3"]
    (tmp_path / "x.obj").write_text("\n".join(lines) + "\n")
    part = only(tmp_path / "x.obj")
    # By place, for a reader may number vertices anew.
    order = (part.mesh.vertices[:, :2] @ [1, 2]).astype(int)
    np.testing.assert_allclose(part.mesh.colours, from_srgb(COLOURS)[order][part.mesh.faces], atol=1e-6)
    assert np.allclose(part.material.albedo, 0.21404 if material else 1, atol=1e-4)


@pytest.mark.parametrize("material", [True, False])
@pytest.mark.parametrize("component, dtype", [(5126, np.float32), (5123, np.uint16), (5121, np.uint8)])
def test_gltf(tmp_path, material, component, dtype):
    """COLOR_0 is linear, as floats or normalised integers; the base colour factor stays."""
    largest = 1 if dtype is np.float32 else np.iinfo(dtype).max
    stored = np.concatenate([COLOURS, [[1.0]] * 3], 1) * largest
    stored = (stored if dtype is np.float32 else np.round(stored)).astype(dtype)
    (tmp_path / "x.glb").write_bytes(glb(stored, component, material))
    part = only(tmp_path / "x.glb")
    expected = stored[:, :3].astype(np.float64) / largest
    np.testing.assert_allclose(part.mesh.colours, expected[part.mesh.faces], atol=1e-6)
    assert np.allclose(part.material.albedo, [0.5, 0.25, 1] if material else 1)


@pytest.mark.parametrize("value", ["2", "nan", "-0.5"])
def test_what_is_no_colour_is_an_error(tmp_path, value):
    (tmp_path / "x.ply").write_text(ply("float", [[0, 0, value], [0, 0, 1], [0, 1, 0]]))
    with pytest.raises(SceneError, match=r"x\.ply has colours of .* they must be 0 \.\.\. 1"):
        only(tmp_path / "x.ply")
