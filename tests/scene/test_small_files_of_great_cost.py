"""Small files that ask for gigabytes or hours: refused in one line, in a child that may have 4 GB of address space.

What took 10 GB or hung before now takes nothing; the child's memory is limited as `ulimit -v 4000000` limits it, and a
hang is ended after a minute.
"""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from limited import each_refused, refused_by
from PIL import Image

from evis.scene import SceneError, load_scene
from evis.scene.images.pictures import MAX_TEXELS, check_size, load_picture

LOAD = "import sys; from evis.scene import load_scene; load_scene(sys.argv[1])"
EACH = "from evis.scene import load_scene; load_scene(argument)"
CAMERA = "cameras: {cam0: {fov: 1}}\nenvironment: 1\n"
MODEL = "<mujoco><asset>{}</asset><worldbody>{}<geom size='1'/></worldbody></mujoco>"


def png(path: Path, width: int, height: int, rows: int | None = None) -> None:
    """A black PNG of one bit a pixel, packed about 1,000 times; `rows` fewer than its header says."""
    data = zlib.compress(bytes((width + 7) // 8 + 1) * (height if rows is None else rows), 9)
    chunks = ((b"IHDR", struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)), (b"IDAT", data), (b"IEND", b""))
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + b"".join(struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in chunks)
    )


def refused(path: Path) -> str:
    """The one line that refuses a scene, which names its file."""
    told = refused_by(LOAD, path)
    assert one_line(told), told
    return told


def one_line(told: str) -> bool:
    """Whether an error is one that can be read."""
    return "\n" not in told and len(told) < 600


def obj_scene(folder: Path) -> Path:
    """A scene with a triangle whose MTL names t.png."""
    (folder / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n")
    (folder / "a.mtl").write_text("newmtl m\nKd 1 1 1\nmap_Kd t.png\n")
    (folder / "s.yaml").write_text(CAMERA + "world: [{shape: mesh, file: a.obj}]\n")
    return folder / "s.yaml"


def gltf_scene(folder: Path, **changes: object) -> Path:
    """A scene with a triangle of a glTF file, its JSON changed."""
    (folder / "b.bin").write_bytes(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32).tobytes())
    tree = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "buffers": [{"uri": "b.bin", "byteLength": 36}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
    }
    (folder / "a.gltf").write_text(json.dumps(tree | changes))
    (folder / "s.yaml").write_text(
        CAMERA + "world: [{shape: mesh, file: a.gltf, material: m}]\nmaterials: {m: {albedo: 1}}\n"
    )
    return folder / "s.yaml"


def model(folder: Path, asset: str = "", body: str = "", text: str = "") -> Path:
    """An MJCF."""
    (folder / "a.xml").write_text(text or MODEL.format(asset, body))
    return folder / "a.xml"


@pytest.mark.parametrize("where", ["scene", "mtl", "ply", "gltf", "gltf embedded", "mjcf texture", "mjcf hfield"])
@pytest.mark.parametrize(("side", "words"), [(60_000, "texels"), (12_000, "of 12000 x 12000 px; 1 to 67108864 texels")])
def test_one_limit_of_pictures_wherever_they_are_named(tmp_path: Path, where: str, side: int, words: str) -> None:
    """A PNG of 0.4 MB and 60,000 x 60,000 pixels by its header took 11 GB; the error names it."""
    png(tmp_path / "t.png", side, side, rows=1)
    if where == "scene":
        path, name = tmp_path / "s.yaml", "s.yaml:3: .*t.png"
        path.write_text(CAMERA + "materials: {m: {texture: {kind: image, file: t.png}}}\n")
    elif where == "mtl":
        path, name = obj_scene(tmp_path), "a.obj names t.png"
    elif where == "ply":
        (tmp_path / "a.ply").write_text(
            "ply\nformat ascii 1.0\ncomment TextureFile t.png\nelement vertex 3\nproperty float x\nproperty float y\n"
            "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
            "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
        )
        path, name = tmp_path / "s.yaml", "a.ply names t.png"
        path.write_text(CAMERA + "world: [{shape: mesh, file: a.ply, material: m}]\nmaterials: {m: {albedo: 1}}\n")
    elif where == "gltf":
        look = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
        path = gltf_scene(tmp_path, images=[{"uri": "t.png"}], textures=[{"source": 0}], materials=[look])
        name = "a.gltf names t.png"
    elif where == "gltf embedded":
        size = (tmp_path / "t.png").stat().st_size
        views = [{"buffer": 0, "byteLength": 36}, {"buffer": 1, "byteLength": size}]
        buffers = [{"uri": "b.bin", "byteLength": 36}, {"uri": "t.bin", "byteLength": size}]
        (tmp_path / "t.png").rename(tmp_path / "t.bin")
        images = [{"bufferView": 1, "name": "wood", "mimeType": "image/png"}]
        path, name = gltf_scene(tmp_path, images=images, buffers=buffers, bufferViews=views), "a.gltf: its image wood"
    elif where == "mjcf texture":
        path, name = model(tmp_path, '<texture name="t" type="2d" file="t.png"/>'), "a.xml:1: names t.png"
    else:
        path, name = model(tmp_path, '<hfield name="t" size="1 1 1 1" file="t.png"/>'), "a.xml:1: names t.png"
    told = refused(path)
    assert all(part in told for part in name.split(".*")) and words in told


@pytest.mark.parametrize("kind", ["scene", "mtl"])
def test_a_picture_may_not_unpack_to_much_more_than_its_file(tmp_path: Path, kind: str) -> None:
    """One colour packs 8,000 x 8,000 pixels into 8 kB, which would be 768 MB; the option that allows it is named."""
    png(tmp_path / "t.png", 8000, 8000)
    path = obj_scene(tmp_path)
    if kind == "scene":
        path.write_text(CAMERA + "materials: {m: {texture: {kind: image, file: t.png}}}\n")
    told = refused(path)
    assert "t.png, of 8000 x 8000 px: " in told and "would unpack to 768 MB" in told and "EVIS_UNPACK_LIMIT=" in told


def test_pictures_of_legal_size_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Up to the limit by texels, and by bytes where the file is as large as pictures are, or the user says so."""
    check_size(8192, 8192, read=20 << 20)
    check_size(4000, 4000, read=0)
    with pytest.raises(SceneError):
        check_size(8193, 8192, read=1 << 30)
    with pytest.raises(SceneError):
        check_size(8192, 8192, read=1000)
    monkeypatch.setenv("EVIS_UNPACK_LIMIT", "1G")
    check_size(8192, 8192, read=1000)
    assert MAX_TEXELS == 8192 * 8192
    Image.new("RGB", (5, 3), (255, 0, 0)).save(tmp_path / "a.bmp")
    assert np.array_equal(load_picture(tmp_path / "a.bmp"), np.broadcast_to(np.float32([1, 0, 0]), (3, 5, 3)))


def test_formats_that_run_programs_are_no_pictures(tmp_path: Path) -> None:
    """PostScript is a program; Pillow hands it to Ghostscript."""
    (tmp_path / "a.png").write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\n")
    with pytest.raises(SceneError, match="which is no picture"):
        load_picture(tmp_path / "a.png")


@pytest.mark.parametrize("damage", ["cut", "no picture"])
def test_damaged_pictures_of_meshes_are_named(tmp_path: Path, damage: str) -> None:
    """Before, a picture that was none was left out without a word, and a cut one raised without its name."""
    path = obj_scene(tmp_path)
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)
    Image.fromarray(noise).save(tmp_path / "t.png")
    data = (tmp_path / "t.png").read_bytes()
    (tmp_path / "t.png").write_bytes(data[: len(data) // 2] if damage == "cut" else b"nothing")
    with pytest.raises(SceneError, match=r"a\.obj names t\.png, which is (a damaged|no) picture") as caught:
        load_scene(str(path))
    assert "\n" not in str(caught.value)


def test_an_obj_of_two_numbers_a_vertex_is_named(tmp_path: Path) -> None:
    path = obj_scene(tmp_path)
    (tmp_path / "a.obj").write_text("v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n")
    with pytest.raises(SceneError, match=r"s\.yaml:3: .*a\.obj") as caught:
        load_scene(str(path))
    assert "\n" not in str(caught.value)


def test_an_exr_of_many_channels_is_refused(tmp_path: Path) -> None:
    """400 channels of 4096 x 4096 zeros would be 27 GB; the channels are counted in the header."""
    import OpenEXR

    small = {f"c{i:03}": np.zeros((4, 8), np.float16) for i in range(400)}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, small) as file:
        file.write(str(tmp_path / "a.exr"))
    data = bytearray((tmp_path / "a.exr").read_bytes())
    at = data.index(b"dataWindow\x00box2i\x00") + len(b"dataWindow\x00box2i\x00") + 4
    data[at + 8 : at + 16] = np.array([4095, 4095], "<i4").tobytes()
    (tmp_path / "a.exr").write_bytes(data)
    (tmp_path / "s.yaml").write_text(CAMERA + "environment_map: a.exr\n")
    told = refused(tmp_path / "s.yaml")
    assert "a.exr" in told and ("EVIS_UNPACK_LIMIT" in told or "cannot be read" in told)


NUMBERS: list[tuple[dict[str, object], str]] = [
    ({"accessors": [{"componentType": 5126, "count": 10**12, "type": "VEC3"}]}, "would unpack to 24 TB"),
    ({"accessors": [{"componentType": 5126, "count": 10**30, "type": "MAT4"}]}, "would unpack to"),
    ({"accessors": [{"componentType": 5126, "count": -5, "type": "VEC3"}]}, "the count -5"),
    ({"accessors": [{"componentType": 5126, "count": 4_000_000, "type": "VEC3"}] * 9}, "would unpack to"),
    ({"bufferViews": [{"buffer": 0, "byteLength": 10**12}]}, "would unpack to"),
    (
        {
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}] * 1000}],
            "nodes": [{"mesh": 0}] * 5000,
            "scenes": [{"nodes": list(range(5000))}],
        },
        "would unpack to",
    ),
]


def test_numbers_in_a_gltf_cost_nothing(tmp_path: Path) -> None:
    scenes = []
    for i, (changes, _) in enumerate(NUMBERS):
        (tmp_path / str(i)).mkdir()
        scenes.append(gltf_scene(tmp_path / str(i), **changes))
    for told, (_, words) in zip(each_refused(EACH, scenes), NUMBERS):
        assert "a.gltf" in told and words in told and one_line(told)


def test_a_gltf_whose_nodes_go_round_in_a_circle_is_refused(tmp_path: Path) -> None:
    told = refused(gltf_scene(tmp_path, nodes=[{"mesh": 0, "children": [1]}, {"children": [0]}]))
    assert "a.gltf: its node 0 is below itself; write it with nodes that form a tree" in told


HEADERS = [
    ("a.stl", bytes(80) + struct.pack("<I", 4_000_000_000) + bytes(50)),
    (
        "a.ply",
        b"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nproperty float y\n"
        b"property float z\nelement face 4000000000\nproperty list uchar int vertex_indices\nend_header\n" + bytes(99),
    ),
    (
        "a.ply",
        b"ply\nformat ascii 1.0\nelement vertex 4000000000\nproperty float x\nproperty float y\nproperty float z\n"
        b"element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    ),
    ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4000000000\n"),
    ("a.glb", b"glTF" + struct.pack("<IIII", 2, 4_000_000_000, 4_000_000_000, 0x4E4F534A) + b"{}"),
    ("a.gltf", b"[" * 400_000),
]


def test_counts_in_headers_of_meshes_cost_nothing(tmp_path: Path) -> None:
    scenes = []
    for i, (name, content) in enumerate(HEADERS):
        (tmp_path / f"{i}{name}").write_bytes(content)
        look = "materials: {m: {albedo: 1}}\n"
        (tmp_path / f"{i}.yaml").write_text(CAMERA + f"world: [{{shape: mesh, file: {i}{name}, material: m}}]\n{look}")
        scenes.append(tmp_path / f"{i}.yaml")
    for i, told in enumerate(each_refused(EACH, scenes)):
        assert f"{i}{HEADERS[i][0]}" in told and one_line(told)


REPLICATE = '<replicate count="{}" offset="1 0 0">{}</replicate>'
GEOM = '<geom size=".1"/>'


MODELS = [
    ("", REPLICATE.format(20_000_000, GEOM), "`replicate` and the like make 20000"),
    ("", REPLICATE.format(1000, REPLICATE.format(1000, GEOM)), "`replicate` and the like make 100"),
    ("", REPLICATE.format("2e7", GEOM), "`replicate` and the like make 20000"),
    ("", '<flexcomp name="a" type="grid" count="1000 1000 1000" dim="3" spacing="1 1 1"/>', "`flexcomp`"),
    ("", '<body><composite type="cable" prefix="a" count="90000000 1 1"/></body>', "`composite`"),
    ('<texture name="t" builtin="flat" type="2d" width="60000" height="60000"/>', "", "60000 x 60000 px"),
    ('<texture name="t" builtin="flat" type="cube" width="9000"/>', "", "9000 x 54000 px"),
    (
        "".join(f'<texture name="t{i}" builtin="flat" type="2d" width="8000" height="8000"/>' for i in range(9)),
        "",
        "a texture of 8000 x 8000 px",
    ),
    ('<hfield name="h" nrow="60000" ncol="60000" size="1 1 1 1"/>', "", "60000 x 60000 samples"),
    ('<hfield name="h" nrow="5000" ncol="5000" size="1 1 1 1"/>', "", "EVIS_UNPACK_LIMIT"),
    ('<mesh name="m" builtin="supersphere" params="30000 1 1"/>', "", "900000000 vertices"),
    ('<mesh name="m" builtin="wedge" params="30000 30000 60 60 .5"/>', "", "900000000 vertices"),
    ("</asset><size nkey='2000000000'/><asset>", "", "nkey is 2000000000"),
    ("</asset><size nuser_geom='200000000'/><asset>", "", "nuser_geom is 200000000"),
    ("</asset><sensor><user dim='2000000000'/></sensor><asset>", "", "dim is 2000000000"),
    ("</asset><include file='b.xml'/><asset>", "", "b.xml:3: `replicate`"),
    ("<model name='m' file='b.xml'/>", "<attach model='m' body='b' prefix='p'/>", "b.xml:3: `replicate`"),
    ("<model name='m' file='a.xml'/>", "<attach model='m' body='b' prefix='p'/>", "a.xml is a part of itself"),
    ("<model name='m' file='c.xml'/>", "<attach model='m' body='b' prefix='p'/>", "a.xml is a part of itself"),
    ("", "<body>" * 100_000, "nested deeper than 500"),
    ("</asset><include file='a.xml'/><asset>", "", "already included"),
]


def test_a_model_is_checked_before_mujoco_expands_it(tmp_path: Path) -> None:
    """Before: 10.5 GB for a texture, hours for a replicate, the death of the process for a model within itself."""
    paths = [tmp_path / str(i) / "a.xml" for i in range(len(MODELS))]
    for path, (asset, body, _) in zip(paths, MODELS):
        path.parent.mkdir()
        (path.parent / "b.xml").write_text(
            "<mujoco>\n<worldbody>\n" + REPLICATE.format(20_000_000, GEOM) + "<body name='b'/></worldbody></mujoco>"
        )
        (path.parent / "c.xml").write_text("<mujoco><asset><model name='m' file='a.xml'/></asset></mujoco>")
        model(path.parent, asset, body)
    for told, (_, _, words) in zip(each_refused(EACH, paths), MODELS):
        assert words in told and ".xml:" in told and one_line(told)


@pytest.mark.parametrize("suffix", ["xml", "urdf"])
def test_entities_are_refused(tmp_path: Path, suffix: str) -> None:
    """Ten levels of ten, the billion laughs."""
    levels = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 10))
    root = "mujoco" if suffix == "xml" else "robot"
    path = tmp_path / f"a.{suffix}"
    path.write_text(f'<!DOCTYPE r [<!ENTITY e0 "ha">{levels}]>\n<{root} name="&e9;"/>')
    assert f"a.{suffix}:1: defines entities" in refused(path)


def test_a_model_of_legal_size_is_as_mujoco_has_it(tmp_path: Path) -> None:
    """Repeats, frames, a field and a texture within the limits."""
    import mujoco

    path = model(
        tmp_path,
        '<hfield name="h" nrow="20" ncol="30" size="1 1 1 1"/><texture name="t" type="2d" builtin="checker" width="64"'
        ' height="64" rgb2="1 1 1"/><material name="m" texture="t"/>',
        f"<frame pos='0 0 1'>{REPLICATE.format(10, REPLICATE.format(5, GEOM))}</frame>"
        "<geom type='hfield' hfield='h' material='m'/><geom size='1' rgba='1 0 0 1' material='m'/>",
    )
    scene, whole = load_scene(str(path)), mujoco.MjModel.from_xml_path(str(path))
    assert len(scene.instances) == whole.ngeom == 53
    textured = [m.texture for m in scene.materials if m.texture is not None]
    assert len(textured) == 2 and textured[0] is textured[1]


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("world:\n  - {shape: plane, size: [1, 1], cells: 100000, material: m}\n", 5, "from 1 to 512"),
        (
            "bodies:\n  b:\n    copies: {over: {i: 50000}}\n    shapes:\n      - copies: {over: {j: 50000}}\n"
            "        shape: sphere\n        radius: 1\n        material: m\n",
            8,
            "makes more than 100000 bodies, shapes, lights and cameras",
        ),
        (
            "world:\n  - copies:\n      over: {i: 100000}\n      let: {"
            + ", ".join(f"v{k}: '${{i}}'" for k in range(20))
            + "}\n    shape: sphere\n    radius: 1\n    material: m\n",
            6,
            "makes 100000 copies of 21 variables each",
        ),
        ("environment_map: {kind: sky, rows: 1000000}\n", 4, "from 16 to 2048"),
    ],
    ids=["cells", "copies of copies", "variables", "sky"],
)
def test_a_scene_file_makes_no_gigabytes(tmp_path: Path, text: str, line: int, words: str) -> None:
    path = tmp_path / "s.yaml"
    path.write_text(CAMERA + "materials: {m: {albedo: 0.5}}\n" + text)
    told = refused(path)
    assert f"s.yaml:{line}: " in told and words in told


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("materials:\n" + "".join(f"  m{i}: {{texture: {{kind: checker, size: 512}}}}\n" for i in range(9)), 6),
        (
            "materials: {m: {albedo: 0.5}}\nworld:\n  - copies: {over: {i: 100}}\n    shape: plane\n"
            "    size: ['${1 + i}', 1]\n    cells: 128\n    material: m\n",
            5,
        ),
    ],
    ids=["textures", "meshes"],
)
def test_what_code_makes_of_a_scene_is_limited_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, line: int
) -> None:
    """Each texture is 3.1 MB and each plane about as much; the third is too much for 8 MB, as 2 GiB are in a run."""
    monkeypatch.setattr("evis.scene.yaml.build.MADE", 8_000_000)
    path = tmp_path / "s.yaml"
    path.write_text(CAMERA + text)
    with pytest.raises(SceneError, match=rf"s\.yaml:{line}: .*EVIS_UNPACK_LIMIT=") as caught:
        load_scene(str(path))
    assert "\n" not in str(caught.value)


def test_values_that_grow_by_let_are_refused(tmp_path: Path) -> None:
    """Each text is the one before it 100 times: the sixth would be 10 TB."""
    lets = ", ".join(f"w{k}: '{f'${{w{k - 1}}}' * 100 if k else 'x' * 10}'" for k in range(7))
    path = tmp_path / "s.yaml"
    path.write_text(CAMERA + f"bodies: {{b: {{copies: {{over: {{i: 2}}, let: {{{lets}}}}}}}}}\n")
    assert "more than 10000 characters" in refused(path)
