"""Scenes from MuJoCo models, against MuJoCo's own numbers."""

import mujoco
import numpy as np
import pytest

from evis.geometry import se3
from evis.scene import SceneError, load_scene
from evis.scene.images.colour import linear_from_srgb

MODEL = """
<mujoco>
  <visual><headlight ambient="0.1 0.2 0.3" diffuse="0.5 0.5 0.5"/></visual>
  <asset>
    <texture name="check" type="2d" builtin="checker" width="8" height="8" rgb1="1 1 1" rgb2="0 0 0"/>
    <texture name="cube" type="cube" builtin="flat" width="4" height="24" rgb1="0.5 0.5 0.5"/>
    <material name="tiles" texture="check" texrepeat="2 3" texuniform="true"/>
    <material name="cubed" texture="cube"/>
    <material name="glow" rgba="1 0.5 0 1" emission="4"/>
    <mesh name="tetra" vertex="0 0 0  0.3 0 0  0 0.2 0  0 0 0.4"/>
  </asset>
  <worldbody>
    <light name="sun" directional="true" dir="0 1 -1" diffuse="1 0.5 0.25" ambient="0.05 0 0"/>
    <light name="bulb" pos="0 0 2" diffuse="1 1 1" intensity="30"/>
    <geom name="floor" type="plane" size="0 0 1" material="tiles"/>
    <body name="base" pos="1 2 3" euler="10 20 30">
      <camera name="fixed_cam" pos="0 0 0.1" fovy="50"/>
      <geom name="plate" type="box" size="0.1 0.2 0.3" pos="0.1 0 0" euler="0 0 45" material="cubed"/>
      <body name="arm" pos="0 0 0.5">
        <joint type="hinge" axis="0 1 0"/>
        <camera name="eye" pos="0.1 0.2 0.3" euler="5 6 7" fovy="70"/>
        <geom name="rod" type="capsule" size="0.02 0.2" rgba="0.2 0.4 0.6 1"/>
        <geom name="collision" type="box" size="1 1 1" group="3"/>
        <geom name="ghost" type="sphere" size="1" rgba="1 1 1 0"/>
        <geom name="tetra" type="mesh" mesh="tetra" material="glow"/>
      </body>
    </body>
    <camera name="flat" projection="orthographic" pos="0 0 9"/>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def model_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("mjcf") / "robot.xml"
    path.write_text(MODEL)
    return path


@pytest.fixture(scope="module")
def scene(model_file):
    return load_scene(str(model_file))


@pytest.fixture(scope="module")
def reference(model_file):
    model = mujoco.MjModel.from_xml_path(str(model_file))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def body_pose(data, i):
    return se3.make_pose(data.xpos[i], se3.from_mujoco(data.xquat[i]))


def test_bodies_are_the_model_s_and_only_the_jointed_ones_move(scene):
    """What is welded to the world needs no engine."""
    assert [b.name for b in scene.bodies] == ["base", "arm", "cam0", "eye"]
    assert scene.bodies[0].trajectory.is_static() and scene.bodies[1].trajectory is None
    assert scene.dynamic


def test_geoms_stand_where_mujoco_has_them(scene, reference):
    """World positions of every mesh against geom_xpos and geom_xmat; groups 3+ and alpha 0 are not drawn."""
    model, data = reference
    assert {i.name for i in scene.instances} == {"floor", "plate", "rod", "tetra"}
    for instance in scene.instances:
        geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, instance.name)
        pose = instance.pose if instance.body < 0 else se3.compose(body_pose(data, instance.body + 1), instance.pose)
        assert np.abs(pose[:3] - data.geom_xpos[geom]).max() < 1e-12
        assert np.abs(se3.to_matrix(pose[3:]) - data.geom_xmat[geom].reshape(3, 3)).max() < 1e-12


def test_sizes(scene):
    """MuJoCo's half sizes as full meshes; the mesh asset's corners, in the world, are those of the file."""
    extent = {i.name: np.ptp(i.mesh.vertices, axis=0) for i in scene.instances}
    assert np.allclose(extent["plate"], [0.2, 0.4, 0.6]) and np.allclose(extent["rod"], [0.04, 0.04, 0.44])
    tetra = next(i for i in scene.instances if i.name == "tetra")
    corners = se3.transform(tetra.pose, np.unique(tetra.mesh.vertices.astype(float), axis=0))
    wanted = np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.2, 0], [0, 0, 0.4]])
    assert np.abs(corners[:, None] - wanted).max(-1).min(0).max() < 1e-6


def test_cameras_look_where_mujoco_s_do(scene, reference):
    """cam_xpos and cam_xmat, turned from MuJoCo's -z to +z; the first that can be is cam0, the others are noted."""
    model, data = reference
    assert [c.name for c in scene.cameras] == ["cam0", "eye"]
    (note,) = scene.notes
    assert note.startswith("camera 'flat' is left out: it is orthographic; with projection=\"perspective\" ")
    fixed = scene.bodies[scene.body_index("cam0")].trajectory.pose(np.zeros(1, np.int64))[0]
    parent, offset = scene.bodies[scene.body_index("eye")].mount
    mounted = se3.compose(body_pose(data, parent + 1), offset)
    for name, pose in (("fixed_cam", fixed), ("eye", mounted)):
        number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, name)
        assert np.abs(pose[:3] - data.cam_xpos[number]).max() < 1e-12
        axes = data.cam_xmat[number].reshape(3, 3) @ np.diag([1.0, -1.0, -1.0])
        assert np.abs(se3.to_matrix(pose[3:]) - axes).max() < 1e-12
    for camera, fovy in zip(scene.cameras, (50, 70)):
        assert np.isclose(camera.k[1, 1], 130 / np.tan(np.radians(fovy / 2)))


def test_lights_follow_the_documented_rule(scene):
    """pi times diffuse for a directional light, intensity for a bulb that has one, ambient terms as environment."""
    sun, bulb = scene.lights
    # MuJoCo's lights are spots of 45 degrees and power 10 unless they say otherwise: half at 21 degrees.
    assert (sun.kind, bulb.kind) == ("directional", "spot")
    assert np.allclose(bulb.direction, [0, 0, -1]) and np.isclose(np.degrees(bulb.cone[1]), 30, atol=0.1)
    assert np.allclose(sun.colour, np.pi * np.array([1, 0.5, 0.25])) and np.allclose(bulb.colour, 30)
    assert np.allclose(sun.vector, np.array([0, 1, -1]) / np.sqrt(2)) and np.allclose(bulb.vector, [0, 0, 2])
    # a light that says nothing has MuJoCo's default ambient of 0
    assert np.allclose(scene.environment, [0.15, 0.2, 0.3])


@pytest.mark.parametrize(("cutoff", "exponent"), [(60, 2), (80, 10), (30, 0), (20, 1)])
def test_spots_fall_to_half_where_their_power_of_the_cosine_does(tmp_path, cutoff, exponent):
    """The step of the renderer's cone, 3 t^2 - 2 t^3 in the cosine; sharp where the power is above half at the edge."""
    light = f'<light name="s" pos="0 0 2" dir="0 1 -1" cutoff="{cutoff}" exponent="{exponent}"/>'
    bulb = '<light name="b" type="point" pos="0 0 1"/>'
    (tmp_path / "spot.xml").write_text(f"<mujoco><worldbody>{light}{bulb}</worldbody></mujoco>")
    spot, point = load_scene(str(tmp_path / "spot.xml")).lights
    assert (spot.kind, point.kind) == ("spot", "point")
    assert np.allclose(spot.direction, np.array([0, 1, -1]) / np.sqrt(2))
    inner, outer = spot.cone
    assert np.degrees(outer) <= cutoff + 1e-5 and 0 <= inner <= outer
    half = 0.5 ** (1 / exponent) if exponent else 0.0
    if half > np.cos(outer):
        t = (half - np.cos(outer)) / (np.cos(inner) - np.cos(outer))
        assert np.isclose(t * t * (3 - 2 * t), 0.5)
    else:
        assert inner == outer and np.isclose(np.degrees(outer), cutoff)


def test_colours_become_linear(scene):
    """Against the sRGB value that everybody knows: 0.5 is 0.2140 linear."""
    assert np.allclose(linear_from_srgb(np.array([0, 0.02, 0.5, 1])), [0, 0.02 / 12.92, 0.21404, 1], atol=1e-5)
    material = {i.name: scene.materials[i.material] for i in scene.instances}
    assert np.allclose(material["rod"].albedo, linear_from_srgb(np.array([0.2, 0.4, 0.6])))
    assert np.allclose(material["tetra"].emission, 4 * linear_from_srgb(np.array([1, 0.5, 0])))
    # Black is the darkest paint.
    assert set(np.unique(material["floor"].texture)) == {np.float32(0.01), 1.0} and material["floor"].texture.shape == (
        8,
        8,
        3,
    )
    assert material["plate"].texture.shape == (24, 4, 3)


def test_textures_repeat_by_the_metre_on_an_infinite_plane(scene):
    """texuniform with texrepeat 2 3: uv grows by 1 and 1.5 per metre, as measured in MuJoCo's own pictures."""
    floor = next(i for i in scene.instances if i.name == "floor").mesh
    corners = floor.vertices[floor.faces].astype(float)
    slope = np.ptp(floor.uv, axis=(0, 1)) / np.ptp(corners[..., :2], axis=(0, 1))
    assert np.allclose(slope, [1, 1.5]) and np.ptp(corners[..., 0]) >= 40


def test_cube_textures_stay_on_their_face(scene):
    """Every triangle of the box lies within one sixth of the atlas."""
    v = next(i for i in scene.instances if i.name == "plate").mesh.uv[..., 1]
    sixth = np.floor((1 - v) * 6)
    assert np.all(sixth.min(axis=1) == sixth.max(axis=1)) and set(sixth[:, 0]) == set(range(6))


def test_scene_file_adds_to_the_model(tmp_path, model_file):
    """Its cameras and lights replace the model's; a camera may ride on a body of the model; bodies may be added."""
    path = tmp_path / "lab.yaml"
    path.write_text(
        f"mjcf: {model_file}\ncameras: {{cam0: {{fov: 1, parent: arm, position: [0, 0, 1]}}}}\n"
        "materials: {m: {}}\nbodies: {ball: {motion: {kind: linear, velocity: [1, 0, 0]}, "
        "shapes: [{shape: sphere, radius: 1, material: m}]}}\n"
        "lights: {key: {kind: point, position: [0, 0, 1], intensity: 2, body: arm}}\nenvironment: 0.5\n"
    )
    scene = load_scene(str(path))
    assert [b.name for b in scene.bodies] == ["base", "arm", "ball", "cam0"]
    assert scene.bodies[3].mount[0] == 1 and np.allclose(scene.bodies[3].mount[1], [0, 0, 1, 0, 0, 0, 1])
    assert [x.name for x in scene.lights] == ["key"] and scene.lights[0].body == 1
    assert np.allclose(scene.environment, 0.5)
    assert scene.instances[-1].name == "ball" and scene.instances[-1].body == 2

    path.write_text(
        f"mjcf: {model_file}\nbodies: {{b: {{parent: arm, motion: {{kind: linear, velocity: [1, 0, 0]}}}}}}\n"
    )
    with pytest.raises(SceneError, match="not possible on 'arm', which the physics engine moves"):
        load_scene(str(path))


def test_a_broken_model_is_one_line(tmp_path):
    """With the element and line that MuJoCo names, and no log file in the working directory."""
    path = tmp_path / "broken.xml"
    path.write_text("<mujoco><worldbody>\n<geom type='ball' size='1'/></worldbody></mujoco>")
    with pytest.raises(SceneError, match=r"broken.xml: .*geom.*line 2") as caught:
        load_scene(str(path))
    assert "\n" not in str(caught.value)


def test_a_model_without_light_gets_a_headlight(tmp_path):
    """As MuJoCo's viewer has it, and a camera that sees all of it."""
    path = tmp_path / "plain.xml"
    path.write_text("<mujoco><worldbody><body><freejoint/><geom size='0.3'/></body></worldbody></mujoco>")
    scene = load_scene(str(path))
    assert [(x.name, x.body) for x in scene.lights] == [("headlight", scene.body_index("cam0"))]
    camera = scene.bodies[scene.body_index("cam0")].trajectory.pose(np.zeros(1, np.int64))[0]
    assert se3.transform(se3.inverse(camera), np.zeros(3))[2] > 0.3


def test_under_a_skin_the_collision_shapes_are_drawn(tmp_path):
    """Of a body that has no others, those of its lowest group; a body without a skin keeps them hidden."""
    (tmp_path / "soft.xml").write_text(
        """<mujoco><worldbody>
        <body name="bare"><freejoint/><geom name="hidden" size="0.1" group="4"/>
        <geom name="core" size="0.1" group="3"/></body>
        <body name="clad" pos="1 0 0"><freejoint/><geom name="seen" size="0.1"/>
        <geom name="shape" size="0.1" group="3"/></body>
        <body name="other" pos="2 0 0"><freejoint/><geom name="solo" size="0.1" group="3"/></body></worldbody>
        <deformable><skin vertex="0 0 0 1 0 0 0 1 0" face="0 1 2">
        <bone body="bare" bindpos="0 0 0" bindquat="1 0 0 0" vertid="0" vertweight="1"/>
        <bone body="clad" bindpos="1 0 0" bindquat="1 0 0 0" vertid="1 2" vertweight="1 1"/></skin>
        </deformable></mujoco>"""
    )
    scene = load_scene(str(tmp_path / "soft.xml"))
    assert {instance.name for instance in scene.instances} == {"core", "seen"}
    assert any("skins are not drawn" in note for note in scene.notes)


@pytest.mark.parametrize(("name", "told"), [("name='start'", "start"), ("", "0"), ("name='home'", "")])
def test_a_keyframe_that_is_not_used_is_told(tmp_path, name, told):
    body = "<body><freejoint/><geom size='.1'/></body>"
    key = f"<keyframe><key {name} qpos='0 0 1 1 0 0 0'/></keyframe>"
    (tmp_path / "m.xml").write_text(f"<mujoco><worldbody>{body}</worldbody>{key}</mujoco>")
    scene = load_scene(str(tmp_path / "m.xml"))
    notes = [note for note in scene.notes if "keyframe" in note]
    assert len(notes) == bool(told) and scene.keyframe == (-1 if told else 0)
    if told:
        assert notes[0].endswith(f"keyframe:={told}")
        assert load_scene(str(tmp_path / "m.xml"), {"keyframe": told}).keyframe == 0


def test_what_has_no_name_is_not_called_as_another(tmp_path):
    """A body called `body2` beside a second one without a name, and so for lights; those with names keep them."""
    (tmp_path / "m.xml").write_text(
        '<mujoco><worldbody><body name="body2" pos="0 0 1"><freejoint/><geom size=".1" mass="1"/></body>'
        '<body pos="0 0 2"><freejoint/><geom size=".1" mass="3"/></body>'
        '<light/><light name="light0"/></worldbody></mujoco>'
    )
    (tmp_path / "s.yaml").write_text("mjcf: m.xml\nmodel: {bodies: {body2: {mass: 5}}}\n")
    scene = load_scene(str(tmp_path / "s.yaml"))
    assert [body.name for body in scene.bodies[:2]] == ["body2", "body2_"]
    assert [light.name for light in scene.lights] == ["light0_", "light0"]
    assert [(change.number, change.values) for change in scene.changes] == [(1, (5.0,))]


@pytest.mark.parametrize("scale", ["1 1 1", "0.5 -1 2"])
def test_a_mesh_with_sharp_edges_is_shaded_flat(tmp_path, scale):
    """A box of eight corners that its file gives no normals of: each side's normal is its own, whatever MuJoCo has."""
    corners = [(x, y, z) for x in (-1, 1) for y in (-2, 2) for z in (-3, 3)]
    sides = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    lines = ["v {} {} {}".format(*corner) for corner in corners] + ["f {} {} {} {}".format(*side) for side in sides]
    (tmp_path / "box.obj").write_text("\n".join(lines) + "\n")
    for smooth in ("false", "true"):
        asset = f'<asset><mesh name="box" file="box.obj" scale="{scale}" smoothnormal="{smooth}"/></asset>'
        path = tmp_path / f"{smooth}.xml"
        path.write_text(f'<mujoco>{asset}<worldbody><geom type="mesh" mesh="box"/></worldbody></mujoco>')
        mesh = load_scene(str(path)).instances[0].mesh
        a, b, c = (mesh.vertices.astype(np.float64)[mesh.faces[:, k]] for k in range(3))
        flat = np.cross(b - a, c - a)
        flat /= np.linalg.norm(flat, axis=-1, keepdims=True)
        cosine = np.einsum("fkx,fx->fk", mesh.normals, flat)
        if smooth == "false":
            np.testing.assert_allclose(cosine, 1.0, atol=1e-6)
        else:  # as the model asks for, every corner has one normal
            assert 0.0 < cosine.min() and cosine.max() < 0.99
