"""Files that other files name: inside of the scene's folders they are read, outside they are refused in one line."""

from __future__ import annotations

import base64
import json
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from evis.scene import SceneError, load_scene
from evis.scene.load import parse_args, scene_args

VERTICES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
OBJ = "mtllib {mtl}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"
URDF = '<robot name="r"><link name="l"><visual><geometry><mesh filename="{}"/></geometry></visual></link></robot>'
CAMERA = "cameras: {cam0: {fov: 1}}\nenvironment: 1\n"


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A scene's folder beside one that is not its own, which has a picture, a mesh, an MTL and a model."""
    for name in ("scene", "outside"):
        (tmp_path / name).mkdir()
    outside = tmp_path / "outside"
    Image.new("RGB", (2, 2), (255, 0, 0)).save(outside / "red.png")
    (outside / "m.mtl").write_text("newmtl m\nKd 1 1 1\nmap_Kd red.png\n")
    (outside / "buffer.bin").write_bytes(VERTICES.tobytes())
    (outside / "part.obj").write_text(OBJ.replace("mtllib {mtl}\n", "") + "v 0 0 1\nf 1 4 2\nf 1 3 4\nf 2 4 3\n")
    (outside / "part.xml").write_text("<mujoco><worldbody><body name='b'><geom size='1'/></body></worldbody></mujoco>")
    return tmp_path / "scene"


def gltf(place: Path, buffer: str, image: str = "") -> None:
    views = [{"buffer": 0, "byteLength": 36}]
    tree = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
        "buffers": [{"uri": buffer, "byteLength": 36}],
        "bufferViews": views,
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC2"},
        ],
        "materials": [{"name": "m"}],
    }
    if image:
        tree |= {"images": [{"uri": image}], "textures": [{"source": 0}]}
        tree["materials"] = [{"name": "m", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    (place / "a.gltf").write_text(json.dumps(tree))


def write(place: Path, kind: str, name: str) -> str:
    """Put a scene into `place` whose file of this kind names `name`. Returns the scene's file."""
    inside = "data:application/octet-stream;base64," + base64.b64encode(VERTICES.tobytes()).decode()
    own = kind == "gltf buffer"
    mesh = "world: [{shape: mesh, file: FILE" + (", material: w" if own else "") + "}]\nmaterials: {w: {albedo: 1}}\n"
    asset, body = "", "<geom size='1'/>"
    if kind.startswith("gltf"):
        gltf(place, *((name, "") if kind == "gltf buffer" else (inside, name)))
        text = mesh.replace("FILE", "a.gltf")
    elif kind.startswith("obj"):
        (place / "a.obj").write_text(OBJ.format(mtl=name if kind == "obj mtl" else "a.mtl"))
        (place / "a.mtl").write_text(f"newmtl m\nKd 1 1 1\nmap_Kd {name}\n")
        text = mesh.replace("FILE", "a.obj")
    elif kind == "urdf":
        (place / "a.urdf").write_text(URDF.format(name))
        text = "mjcf: a.urdf\n"
    else:
        if kind == "include":
            asset = f'</asset><include file="{name}"/><asset>'
        elif kind == "model":
            asset = f'<model name="m" file="{name}"/>'
            body += '<attach model="m" body="b" prefix="p"/>'
        elif kind in ("texture", "hfield"):
            asset = f'<{kind} name="t" {"type=" + chr(34) + "2d" + chr(34) if kind == "texture" else ""} file="{name}"'
            asset += ' size="1 1 1 1"/>' if kind == "hfield" else "/>"
        else:
            folder, _, last = name.rpartition("/")
            compiler = {"meshdir": f'<compiler meshdir="{folder}"/>', "assetdir": f'<compiler assetdir="{folder}"/>'}
            asset = f'<mesh name="t" file="{name if kind == "mesh" else last}"/>'
            asset = f"</asset>{compiler.get(kind, '')}<asset>{asset}"
        (place / "a.xml").write_text(f"<mujoco><asset>{asset}</asset><worldbody>{body}</worldbody></mujoco>")
        text = "mjcf: a.xml\n"
    (place / "s.yaml").write_text(CAMERA + text)
    return str(place / "s.yaml")


NAMES = {
    "gltf buffer": "buffer.bin", "gltf image": "red.png", "obj mtl": "m.mtl", "obj image": "red.png",
    "urdf": "part.obj", "mesh": "part.obj", "meshdir": "part.obj", "assetdir": "part.obj",
    "texture": "red.png", "hfield": "red.png", "include": "part.xml", "model": "part.xml",
}  # fmt: skip


CASES = [
    *((kind, how) for kind in NAMES for how in ("climb", "absolute", "linked folder")),
    *((kind, "link") for kind in NAMES if kind not in ("meshdir", "assetdir")),
    *((kind, "encoded") for kind in ("gltf buffer", "gltf image")),
    *((kind, "file uri") for kind in ("gltf buffer", "gltf image", "obj mtl", "obj image", "urdf")),
]


@pytest.mark.parametrize(("kind", "how"), CASES)
def test_what_leads_out_is_refused_and_what_is_stated_is_not(place: Path, kind: str, how: str) -> None:
    """The error names the file, what it names and the line that allows it, which does."""
    outside = place.parent / "outside"
    name = NAMES[kind]
    if how == "link":
        (place / name).symlink_to(outside / name)
        called = name
    elif how == "linked folder":
        (place / "sub").symlink_to(outside)
        called = f"sub/{name}"
    else:
        called = {
            "climb": f"../outside/{name}", "absolute": str(outside / name), "encoded": f"%2e%2e/outside%2F{name}",
            "file uri": f"file://{outside / name}",
        }[how]  # fmt: skip
    path = write(place, kind, called)
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    told = str(caught.value)
    assert "outside of the scene's folders" in told and "state `assets: [../outside]` in the scene file" in told
    assert "\n" not in told and str(outside / name) in told and "a." in told
    with Path(path).open("a") as file:
        file.write("assets: [../outside]\n")
    scene = load_scene(path)
    if kind.endswith("image"):
        texture = next(m.texture for m in scene.materials if m.texture is not None)
        assert np.array_equal(texture, np.broadcast_to(np.float32([1, 0, 0]), (2, 2, 3)))


@pytest.mark.parametrize("kind", NAMES)
def test_what_lies_below_is_read(place: Path, kind: str) -> None:
    """Also by way of a folder above it, percent-encoded, or by its whole path."""
    (place.parent / "outside").rename(place / "sub dir")
    called = [f"sub dir/{NAMES[kind]}", f"../scene/sub dir/{NAMES[kind]}", str(place / "sub dir" / NAMES[kind])]
    if kind.startswith("gltf"):
        called.append(f"sub%20dir/{NAMES[kind]}")
    for name in called:
        assert load_scene(write(place, kind, name)).cameras


def test_the_folder_of_what_the_scene_names_counts_as_stated(place: Path) -> None:
    """`mjcf: ../robots/x.xml` may read what lies beside x.xml; so may a mesh."""
    outside = place.parent / "outside"
    (outside / "r.xml").write_text(
        '<mujoco><compiler meshdir="../outside"/><asset><mesh name="t" file="part.obj"/></asset><worldbody>'
        '<geom type="mesh" mesh="t"/></worldbody></mujoco>'
    )
    (outside / "r.obj").write_text(OBJ.format(mtl="m.mtl"))
    for text in ("mjcf: ../outside/r.xml\n", "world: [{shape: mesh, file: ../outside/r.obj}]\n"):
        (place / "s.yaml").write_text(CAMERA + text)
        assert len(load_scene(str(place / "s.yaml")).instances) == 1


def test_a_model_by_itself_takes_folders_from_the_command_line(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Relative to where it is launched; several with commas. What moves the bodies has them too."""
    from nodes.physics.engines.mujoco_engine import MujocoEngine

    write(place, "mesh", "../outside/part.obj")
    model = str(place / "a.xml")
    monkeypatch.chdir(place.parent)
    with pytest.raises(
        SceneError, match=r"a\.xml:1: '\.\./outside/part\.obj' is .*; to allow it, give assets:=outside$"
    ):
        load_scene(model)
    assert "assets" in scene_args(model) and "keyframe" in scene_args(model)
    for stated in ("outside", f"scene,{place.parent / 'outside'}"):
        scene = load_scene(model, {"assets": stated})
        assert MujocoEngine(scene).model.nmesh == 1
    scene.folders = None
    with pytest.raises(SceneError, match="outside of the scene's folders"):
        MujocoEngine(scene)
    with pytest.raises(SceneError, match="names nowhere, which is no folder"):
        load_scene(model, {"assets": "nowhere"})


def test_the_command_line_hands_the_folders_on(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`evis launch a.xml assets:=outside,scene`, and as nodes get it in their `scene_args`."""
    from evis.cli import main

    write(place, "mesh", "../outside/part.obj")
    monkeypatch.chdir(place.parent)
    assert main(["launch", "scene/a.xml", "assets:=outside,scene", "--explain"]) == 0
    assert main(["launch", "scene/a.xml", "folders:=outside", "--explain"]) == 2
    assert load_scene("scene/a.xml", parse_args("assets=outside,scene,keyframe=none")).cameras


def test_models_laid_out_as_they_usually_are_need_no_option(tmp_path: Path) -> None:
    """Assets in a folder below, shared includes, names without their folder, comments that are not quite XML."""
    import mujoco

    (tmp_path / "assets" / "visual").mkdir(parents=True)
    Image.new("RGB", (2, 2), (255, 0, 0)).save(tmp_path / "assets" / "visual" / "red.png")
    tetrahedron = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    for folder in ("assets", "assets/visual"):
        (tmp_path / folder / "part.obj").write_text(tetrahedron)
    (tmp_path / "common.xml").write_text(
        '<mujocoinclude><asset><texture name="t" type="2d" file="visual/red.png"/></asset></mujocoinclude>'
    )
    (tmp_path / "robot.xml").write_text(
        '<?xml version="1.0"?>\n<!-- a -- b & c <mesh file="/etc/passwd"/> -->\n<!DOCTYPE mujoco>\n'
        '<mujoco model="r"><compiler meshdir="assets" texturedir="assets/"/><include file="common.xml"/>'
        '<asset><mesh name="a" file="part.obj"/><mesh name="b" file="visual/part.obj"/>'
        '<material name="m" texture="t"/></asset><worldbody><replicate count="3" offset="1 0 0">'
        '<body><freejoint/><geom type="mesh" mesh="a" material="m"/></body></replicate>'
        '<geom type="mesh" mesh="b"/></worldbody></mujoco>'
    )
    scene = load_scene(str(tmp_path / "robot.xml"))
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
    assert len(scene.instances) == model.ngeom == 4 and len(scene.bodies) == model.nbody - 1 + len(scene.cameras)
    (tmp_path / "flat.xml").write_text(
        '<mujoco><compiler strippath="true" meshdir="assets"/><asset><mesh file="C:/their/own/part.obj"/></asset>'
        '<worldbody><geom type="mesh" mesh="part"/></worldbody></mujoco>'
    )
    assert len(load_scene(str(tmp_path / "flat.xml")).instances) == 1


def test_packages_by_name_alone_are_no_way_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`package://etc/x` would be /etc/x, above every robot; with a package.xml, or in ROS's paths, it is a package."""
    for name in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(name, raising=False)
    robot = tmp_path / "downloads" / "r.urdf"
    part = tmp_path / "other" / "part.obj"
    for path in (robot, part):
        path.parent.mkdir()
    part.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    robot.write_text(URDF.format("package://other/part.obj"))
    with pytest.raises(SceneError, match=r"r\.urdf: 'package://other/part\.obj' is .*give assets:="):
        load_scene(str(robot))
    assert load_scene(str(robot), {"assets": str(part.parent)}).instances
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path))
    (part.parent / "package.xml").write_text("<package><name>other</name></package>")
    assert load_scene(str(robot)).instances
    secret = tmp_path / "secret.obj"
    secret.write_text(part.read_text())
    robot.write_text(URDF.format("package://other/../secret.obj"))
    with pytest.raises(SceneError, match="outside of the scene's folders"):
        load_scene(str(robot))


def test_installed_packages_may_be_links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As colcon installs them with --symlink-install."""
    source, share = tmp_path / "src" / "part.obj", tmp_path / "install" / "share" / "arm"
    for folder in (source.parent, share, tmp_path / "here"):
        folder.mkdir(parents=True)
    source.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    os.symlink(source, share / "part.obj")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "install"))
    (tmp_path / "here" / "r.urdf").write_text(URDF.format("package://arm/part.obj"))
    assert load_scene(str(tmp_path / "here" / "r.urdf")).instances


def test_a_name_left_by_another_machine_is_looked_for_beside_the_mesh(place: Path) -> None:
    """Modellers write whole paths into an MTL; where there is no such file, the one beside the mesh is meant."""
    (place.parent / "outside" / "red.png").rename(place / "red.png")
    scene = load_scene(write(place, "obj image", "/home/somebody/else/red.png"))
    assert scene.cameras


def test_names_are_spelled_as_mujoco_spells_them(place: Path) -> None:
    """With one of HTML's entities the file that was looked for was not the one that MuJoCo reads."""
    (place / "a&sol;b").mkdir()
    for name in ("a&sol;b/../../outside/part.xml", "..&#47;outside&#x2F;part.xml"):
        (place / "m.xml").write_text(
            f'<mujoco><include file="{name}"/><worldbody><geom size="1"/></worldbody></mujoco>'
        )
        with pytest.raises(SceneError, match="outside of the scene's folders"):
            load_scene(place / "m.xml")


def test_a_urdf_is_read_in_the_encoding_in_which_it_was_checked(place: Path) -> None:
    """In UTF-16 nothing that it names was found, and all of it was read."""
    inertia = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    ball = '<visual><geometry><sphere radius="1"/></geometry></visual>'
    text = f'<?xml version="1.0" encoding="{{}}"?><robot name="r"><link name="l">{inertia}{ball}</link></robot>'
    (place / "r.urdf").write_bytes(text.format("utf-16").encode("utf-16"))
    with pytest.raises(SceneError, match=r"r\.urdf: XML parse error"):
        load_scene(place / "r.urdf")
    # What says that it is Latin-1 has letters of that in its comments; with the mark of UTF-8 it is as good.
    (place / "r.urdf").write_bytes(
        text.format("iso-8859-1").replace("<link", "<!-- R\u00fcssel --><link").encode("latin-1")
    )
    assert load_scene(place / "r.urdf").bodies
    (place / "r.urdf").write_bytes(text.format("utf-8").encode("utf-8-sig"))
    assert load_scene(place / "r.urdf").bodies
