"""What mesh files say of their surfaces: textures and how they lie, numbers in whole parts, what is not there."""

import base64
import io
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from evis.scene import SceneError, load_scene
from evis.scene.mesh.files import load_parts

CORNERS = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], np.float32)
UV = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], np.float32)
FACES = [(0, 1, 2), (0, 2, 3)]
SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
QUAD = "f 1/1 2/2 3/3 4/4\n"


def uri(content: bytes) -> str:
    return "data:application/octet-stream;base64," + base64.b64encode(content).decode()


def picture(texels: list) -> str:
    out = io.BytesIO()
    Image.fromarray(np.array(texels, np.uint8)).save(out, "PNG")
    return uri(out.getvalue())


def gltf(path: Path, arrays: dict[str, np.ndarray], materials: list, pictures: tuple = (), **top) -> Path:
    """One square for each material, its attributes the arrays; whole numbers count as parts of their largest."""
    kinds = {"f4": 5126, "i2": 5122, "u2": 5123, "u1": 5121}
    data, views, accessors = b"", [], []
    for values in (*arrays.values(), np.array(FACES, "<u2").reshape(-1, 1)):
        content = values.tobytes() + bytes(-values.nbytes % 4)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": values.nbytes})
        kind = {1: "SCALAR", 2: "VEC2", 3: "VEC3"}[values.shape[1]]
        code = kinds[values.dtype.str[1:]]
        accessors.append({"bufferView": len(accessors), "componentType": code, "count": len(values), "type": kind})
        data += content
    for accessor in accessors[:-1]:
        accessor["normalized"] = accessor["componentType"] != 5126
    attributes = {name: k for k, name in enumerate(arrays)}
    primitives = [
        {"attributes": dict(attributes), "indices": len(arrays), "material": k} for k, _ in enumerate(materials)
    ]
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": primitives}], "materials": materials, "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": len(data), "uri": uri(data)}], "images": [{"uri": text} for text in pictures],
        "textures": [{"source": k} for k, _ in enumerate(pictures)], **top,
    }  # fmt: skip
    path.write_text(json.dumps(document))
    return path


def upright(points: np.ndarray) -> np.ndarray:
    return np.stack((points[:, 0], -points[:, 2], points[:, 1]), axis=-1)


def materials_of(path: Path) -> list:
    return [part.material for part in load_parts(path, np.ones(3))]


def test_a_texture_of_roughness_emission_and_metal_counts_by_its_mean(tmp_path):
    """glTF: green is roughness and blue metallic, both linear; emission is sRGB: of black and white the half."""
    rough = picture([[[9, 51, 0], [9, 153, 102]]])
    half = picture([[[0, 0, 0], [255, 255, 255]]])
    (material,) = materials_of(
        gltf(
            tmp_path / "a.gltf",
            {"POSITION": CORNERS, "TEXCOORD_0": UV},
            [{
                "name": "m", "emissiveFactor": [1, 0.5, 0], "emissiveTexture": {"index": 1},
                "pbrMetallicRoughness": {"metallicRoughnessTexture": {"index": 0}, "roughnessFactor": 0.5},
            }],
            (rough, half),
        )
    )  # fmt: skip
    assert np.isclose(material.roughness, 0.5 * 0.4) and np.isclose(material.metallic, 0.2)
    assert np.allclose(material.emission, [0.5, 0.25, 0])


def test_materials_without_a_name_or_of_one_name_are_told_apart(tmp_path):
    """glTF: what 8 bits do not tell apart is each its own, exactly."""
    said = [{"pbrMetallicRoughness": {"baseColorFactor": [value, 0.5, 0.5, 1]}} for value in (0.0012, 0.0018)]
    strong = {"KHR_materials_emissive_strength": {"emissiveStrength": 5}}
    said += [{"name": "x", "emissiveFactor": [1, 1, 1], "extensions": extensions} for extensions in ({}, strong)]
    found = materials_of(gltf(tmp_path / "a.gltf", {"POSITION": CORNERS}, said))
    values = sorted((float(m.albedo[0]), float(m.emission[0])) for m in found)
    assert np.allclose(values, [(0.0012, 0), (0.0018, 0), (1, 1), (1, 5)], rtol=1e-6)


def test_a_texture_lies_as_its_transform_says(tmp_path):
    """KHR_texture_transform: scaled, turned counter-clockwise as it is seen, moved; of the second coordinates too."""
    change = {"offset": [0.25, 0.5], "rotation": np.pi / 6, "scale": [3.0, 2.0], "texCoord": 1}
    texture = {"index": 0, "texCoord": 0, "extensions": {"KHR_texture_transform": change}}
    path = gltf(
        tmp_path / "a.gltf", {"POSITION": CORNERS, "TEXCOORD_0": 0 * UV, "TEXCOORD_1": UV},
        [{"pbrMetallicRoughness": {"baseColorTexture": texture}}], (picture([[[9, 9, 9]]]),),
        extensionsRequired=["KHR_texture_transform"],
    )  # fmt: skip
    ((part,)) = load_parts(path, np.ones(3))
    # With v upwards a turn is the usual one: complex numbers.
    seen = 3 * UV[:, 0] - 2j * UV[:, 1]
    moved = seen * np.exp(1j * np.pi / 6) + (0.25 - 0.5j)
    expected = np.stack((moved.real, 1 + moved.imag), axis=-1)
    assert np.allclose(part.mesh.uv, expected[part.mesh.faces], atol=1e-6)


def test_whole_numbers_are_parts_of_their_largest(tmp_path):
    """Normalised places and texture coordinates, as compressed glTF has them."""
    arrays = {
        "POSITION": (16384 * CORNERS - 32767 * (1 - CORNERS)).astype("<i2"),
        "TEXCOORD_0": (255 * UV).astype("u1"),
    }
    path = gltf(
        tmp_path / "a.gltf", arrays, [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        (picture([[[9, 9, 9]]]),), extensionsRequired=["KHR_mesh_quantization"],
    )  # fmt: skip
    (part,) = load_parts(path, np.ones(3))
    places = upright(np.maximum(arrays["POSITION"] / 32767, -1))
    assert np.allclose(part.mesh.vertices[part.mesh.faces], places[FACES], atol=1e-6)
    assert np.allclose(part.mesh.uv, np.stack((UV[:, 0], 1 - UV[:, 1]), axis=-1)[FACES], atol=1e-6)


def test_sparse_numbers_stand_in_their_places(tmp_path):
    """One corner moved by a sparse accessor."""
    path = gltf(tmp_path / "a.gltf", {"POSITION": CORNERS, "M": np.array([(0, 0, 7)], "<f4")}, [{}])
    document = json.loads(path.read_text())
    del document["meshes"][0]["primitives"][0]["attributes"]["M"]
    place = {"bufferView": 2, "byteOffset": 4, "componentType": 5123}  # the third index of FACES, a 2
    document["accessors"][0]["sparse"] = {"count": 1, "indices": place, "values": {"bufferView": 1}}
    path.write_text(json.dumps(document))
    (part,) = load_parts(path, np.ones(3))
    moved = CORNERS.copy()
    moved[2] = 0, 0, 7
    assert np.allclose(part.mesh.vertices[part.mesh.faces], upright(moved)[FACES])


@pytest.mark.parametrize("name", ["KHR_draco_mesh_compression", "EXT_meshopt_compression"])
def test_what_a_file_cannot_be_read_without_is_named(tmp_path, name):
    """glTF: compressed, its corners were all taken for 0."""
    path = gltf(tmp_path / "a.gltf", {"POSITION": CORNERS}, [{}], extensionsRequired=[name])
    with pytest.raises(SceneError, match=rf"a\.gltf: needs the extension {name}, which is not read; export it without"):
        load_parts(path, np.ones(3))


def test_mtl_says_more_than_kd(tmp_path):
    """Ke is a radiance, Pr and Pm are glTF's values; a picture without Kd has its own colours, laid as -s, -o say."""
    Image.new("RGB", (2, 2), (188, 0, 0)).save(tmp_path / "my wood.png")
    (tmp_path / "a.mtl").write_text(
        "newmtl lamp\nKd 0 0 0\nKe 3 2 0.5\nPr 0.25\nPm 0.75\n"
        "newmtl wood\nmap_Kd -clamp on -s 2 3 1 -o 0.5 my wood.png\n"
    )
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\n{SQUARE}usemtl lamp\n{QUAD}usemtl wood\n{QUAD}")
    lamp, wood = sorted(load_parts(tmp_path / "a.obj", np.ones(3)), key=lambda part: part.material.name)
    assert lamp.material.emission.tolist() == [3, 2, 0.5]
    assert (lamp.material.roughness, lamp.material.metallic) == (0.25, 0.75)
    assert wood.material.albedo.tolist() == [1, 1, 1] and np.allclose(
        wood.material.texture[0, 0], [0.5029, 0, 0], atol=1e-4
    )
    corners = wood.mesh.vertices[wood.mesh.faces][..., :2]
    assert np.allclose(wood.mesh.uv, corners * [2, 3] + [0.5, 0]) and not wood.lacks


@pytest.fixture
def load(tmp_path):
    def load(world: str, head: str = ""):
        text = f"cameras: {{cam0: {{fov: 1}}}}\n{head}environment: 1\nworld:\n{world}"
        (tmp_path / "s.yaml").write_text(text)
        return load_scene(str(tmp_path / "s.yaml"))

    return load


@pytest.mark.parametrize("head", ["", "mtllib gone.mtl\nusemtl paint\n"])
def test_texture_coordinates_are_no_material(load, tmp_path, head):
    """An OBJ that has them and no MTL asks for a material; it was painted almost black."""
    (tmp_path / "a.obj").write_text(head + SQUARE + QUAD)
    told = r" \(it names gone\.mtl, which is not there\)" if head else ""
    with pytest.raises(SceneError, match=rf"a\.obj, which has no material{told}; add 'material'"):
        load("  - {shape: mesh, file: a.obj}\n")
    scene = load("  - {shape: mesh, file: a.obj, material: m}\n", "materials: {m: {albedo: 0.25}}\n")
    assert scene.materials[scene.instances[0].material].name == "m" and not scene.left_out


def test_pictures_that_are_not_there_are_told(load, tmp_path):
    """Of MTL and of glTF; the mesh is drawn without."""
    (tmp_path / "a.mtl").write_text("newmtl paint\nKd 1 0 0\nmap_Kd gone.png\n")
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\nusemtl paint\n{SQUARE}{QUAD}")
    texture = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    gltf(tmp_path / "b.gltf", {"POSITION": CORNERS, "TEXCOORD_0": UV}, [texture], ("away.png",))
    scene = load("  - {name: a, shape: mesh, file: a.obj}\n  - {name: b, shape: mesh, file: b.gltf}\n")
    assert [note.partition(";")[0] for note in scene.left_out] == [
        "a.obj names gone.png, which is not there",
        "b.gltf names away.png, which is not there",
    ]


@pytest.mark.parametrize(
    "material, how",
    [
        ({"alphaMode": "OPAQUE", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0]}}, ""),
        ({"alphaMode": "MASK"}, "alphaMode MASK"),
        ({"alphaMode": "BLEND"}, "alphaMode BLEND"),
        ({"extensions": {"KHR_materials_transmission": {"transmissionFactor": 0.9}}}, "KHR_materials_transmission"),
        ("d 1\nTr 1\n", ""),
        ("d 0.25\n", "d 0.25"),
        ("Tr 0.75\n", "Tr 0.75"),
        ("map_d holes.png\n", "map_d"),
    ],
)
def test_what_lets_light_through_is_told_for_it_is_drawn_opaque(load, tmp_path, material, how):
    """Leaves cut out of their pictures and panes, by glTF 2.0's alphaMode and MTL's dissolve; alpha of what is opaque
    by the file's own word is none.
    """
    if isinstance(material, str):
        name = "leaf.obj"
        (tmp_path / "leaf.mtl").write_text(f"newmtl leaf\nKd 0.5 0.5 0.5\n{material}")
        (tmp_path / name).write_text(f"mtllib leaf.mtl\n{SQUARE}usemtl leaf\n{QUAD}")
    else:
        name = gltf(tmp_path / "leaf.gltf", {"POSITION": CORNERS}, [{"name": "leaf", **material}]).name
    told = [f"{name} has material 'leaf' with {how}, which is drawn opaque"] if how else []
    assert load(f"  - {{shape: mesh, file: {name}}}\n").left_out == told


def test_files_of_one_name_keep_their_own_materials(load, tmp_path):
    """Two folders, a file `model.obj` with a material `paint` in each."""
    for folder, colour in (("a", "1 0 0"), ("b", "0 1 0")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "m.mtl").write_text(f"newmtl paint\nKd {colour}\n")
        (tmp_path / folder / "model.obj").write_text(f"mtllib m.mtl\nusemtl paint\n{SQUARE}{QUAD}")
    entries = [("p", "a"), ("q", "b"), ("r", "a")]
    scene = load("".join(f"  - {{name: {n}, shape: mesh, file: {f}/model.obj}}\n" for n, f in entries))
    seen = [scene.materials[i.material].albedo.tolist() for i in scene.instances]
    assert seen == [[1, 0, 0], [0, 1, 0], [1, 0, 0]] and len(scene.materials) == 2


def test_texts_may_be_latin_1(load, tmp_path):
    """An accent in a comment and in the name of a picture."""
    Image.new("RGB", (1, 1), (255, 0, 0)).save(tmp_path / "écorce.png")
    (tmp_path / "a.mtl").write_bytes("newmtl paint\nmap_Kd écorce.png\n".encode("latin-1"))
    (tmp_path / "a.obj").write_bytes(f"# modélisé\nmtllib a.mtl\nusemtl paint\n{SQUARE}{QUAD}".encode("latin-1"))
    scene = load("  - {shape: mesh, file: a.obj}\n")
    assert scene.materials[0].texture.tolist() == [[[1, 0, 0]]] and not scene.left_out


def test_an_stl_that_is_cut_off_says_so(tmp_path):
    """Not that a module is missing."""
    (tmp_path / "a.stl").write_bytes(bytes(80) + (3).to_bytes(4, "little") + b"\xff" * 50)
    with pytest.raises(SceneError, match="it has 134 bytes, where 3 triangles have 234"):
        load_parts(tmp_path / "a.stl", np.ones(3))


@pytest.mark.parametrize("colours", [{}, {"COLOR_0": np.full((4, 3), 0.5, np.float32)}])
def test_texture_coordinates_of_a_gltf_without_material_are_for_that_of_the_scene(tmp_path, colours):
    path = gltf(tmp_path / "a.gltf", {"POSITION": CORNERS, "TEXCOORD_0": UV, **colours}, [{"name": "m"}])
    tree = json.loads(path.read_text())
    del tree["meshes"][0]["primitives"][0]["material"], tree["materials"]
    path.write_text(json.dumps(tree))
    (part,) = load_parts(path, np.ones(3))
    assert np.allclose(part.mesh.uv, np.stack((UV[:, 0], 1 - UV[:, 1]), axis=-1)[FACES])
    assert (part.material is None) == (not colours) and (part.mesh.colours is None) == (not colours)
    if colours:
        assert part.material.name == "a_white" and np.allclose(part.mesh.colours, 0.5)


def obj(folder: Path, text: str) -> dict:
    """Texture coordinates at the vertices, by the material's name, of an OBJ beside a.mtl, b.mtl and sub/c.mtl."""
    (folder / "sub").mkdir(exist_ok=True)
    (folder / "a.mtl").write_text("newmtl A\nKd 1 0 0\nmap_Kd white.png\n")
    (folder / "b.mtl").write_text("newmtl B\nKd 0 1 0\nnewmtl A\nKd 0 0 1\n")
    (folder / "sub" / "c.mtl").write_text("newmtl C\nmap_Kd white.png\n")
    for place in (folder, folder / "sub"):
        Image.new("RGB", (1, 1), "white").save(place / "white.png")
    (folder / "m.obj").write_text(text, newline="")
    found = {}
    for part in load_parts(folder / "m.obj", np.ones(3)):
        assert part.lacks == () and part.material is not None
        corners = zip(part.mesh.vertices[part.mesh.faces].reshape(-1, 3), part.mesh.uv.reshape(-1, 2))
        key = (part.material.name, *part.material.albedo.tolist(), part.material.texture is not None)
        found[key] = {tuple(p[:2].tolist()): tuple(uv.tolist()) for p, uv in corners}
    return found


def test_all_libraries_of_an_obj_count(tmp_path):
    """Each line and each name of one; the first that defines a material wins; pictures lie beside their MTL too."""
    faces = "usemtl A\nf 1/1 2/2 3/3\nusemtl B\nf 1/1 3/3 4/4\nusemtl C\nf 1/1 3/3 4/4\n"
    expected = {("m_A", 1, 0, 0, True), ("m_B", 0, 1, 0, False), ("m_C", 1, 1, 1, True)}
    for names in ("mtllib a.mtl\nmtllib b.mtl\nmtllib sub/c.mtl\n", "# mtllib no.mtl\nmtllib a.mtl b.mtl sub/c.mtl\n"):
        assert set(obj(tmp_path, names + SQUARE + faces)) == expected
    (tmp_path / "lone.obj").write_text("mtllib a.mtl no.mtl\n" + SQUARE + "usemtl A\n" + QUAD)
    (part,) = load_parts(tmp_path / "lone.obj", np.ones(3))
    assert part.lacks == ("names no.mtl, which is not there",) and part.material.name == "lone_A"


@pytest.mark.parametrize("faces", ["f 1/1 2/2 3/3\nf 1 3 4\n", "f 1/1/1 2/2/1 3/3/1\nf 1//1 3//1 4//1\n"])
def test_faces_without_coordinates_leave_those_of_others(tmp_path, faces):
    (found,) = obj(tmp_path, "mtllib a.mtl\n" + SQUARE + "vn 0 0 1\nusemtl A\n" + faces).values()
    assert found[1, 0] == (1, 0) and found[0, 1] == (0, 0)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace(" ", "\t"),
        lambda text: text.replace("\n", "\n  "),
        lambda text: text.replace("\n", "  # usemtl B\n", 6),
        lambda text: text.replace("\n", "\r"),
        lambda text: "\ufeff" + text,
    ],
)
def test_an_obj_may_be_spelled_in_other_ways(tmp_path, change):
    found = obj(tmp_path, change(SQUARE + "mtllib a.mtl\nusemtl A\n" + QUAD))
    assert found == {("m_A", 1, 0, 0, True): {(x, y): (x, y) for x in (0, 1) for y in (0, 1)}}


@pytest.mark.parametrize(
    ("face", "said"),
    [("f 0/1 2/2 3/3\n", "number 0; .*count from 1"), ("f 1/1 2/2 3/9\n", "texture coordinates 9; there are 4")],
)
def test_a_face_that_counts_wrong_is_named(tmp_path, face, said):
    with pytest.raises(SceneError, match=rf"m\.obj .*a face names {said}"):
        obj(tmp_path, SQUARE + face)
