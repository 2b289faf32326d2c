"""URDF robots, against the numbers in the file."""

import numpy as np
import pytest

from evis.geometry import se3
from evis.scene import SceneError, load_scene
from evis.scene.load import is_dynamic

URDF = """<robot name="two_links">
  <link name="base">
    <visual><geometry><box size="0.2 0.4 0.1"/></geometry>
      <material name="p"><color rgba="0.5 0 1 1"/></material></visual>
    <collision><geometry><sphere radius="0.3"/></geometry></collision>
  </link>
  <link name="arm">
    <inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><origin xyz="0 0 0.25"/><geometry><cylinder radius="0.02" length="0.5"/></geometry></visual>
    <collision><origin xyz="0 0 0.25"/><geometry><cylinder radius="0.04" length="0.5"/></geometry></collision>
  </link>
  <link name="tip">
    <inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><sphere radius="0.05"/></geometry></collision>
  </link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0.1 0 0.05"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="wrist" type="continuous"><parent link="arm"/><child link="tip"/><origin xyz="0 0 0.5"/>
    <axis xyz="0 0 1"/></joint>
</robot>
"""


@pytest.fixture
def robot(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(URDF)
    return path


def test_visual_geometry_is_drawn_where_there_is_any(robot):
    """Base and arm as their visuals say, the tip, which has none, as its collision sphere; colours from sRGB."""
    scene = load_scene(str(robot))
    assert is_dynamic(str(robot)) and [b.name for b in scene.bodies] == ["arm", "tip", "cam0"]
    seen = {(scene.bodies[i.body].name if i.body >= 0 else "world"): i for i in scene.instances}
    assert len(scene.instances) == 3 and set(seen) == {"world", "arm", "tip"}
    sizes = {name: np.ptp(i.mesh.vertices, axis=0) for name, i in seen.items()}
    assert np.allclose(sizes["world"], [0.2, 0.4, 0.1]) and np.allclose(sizes["arm"], [0.04, 0.04, 0.5], atol=1e-4)
    assert np.allclose(sizes["tip"][2], 0.1) and np.allclose(seen["arm"].pose[:3], [0, 0, 0.25])
    assert np.allclose(scene.materials[seen["world"].material].albedo, [0.21404, 0.01, 1], atol=1e-5)


def test_a_scene_file_may_name_one(robot, tmp_path):
    """Same path as an MJCF; without visuals the bodies are the same, so that the engine and the renderer agree."""
    (tmp_path / "lab.yaml").write_text("mjcf: robot.urdf\ncameras: {cam0: {fov: 1, parent: tip}}\n")
    scene, bare = (load_scene(str(tmp_path / "lab.yaml"), visuals=v) for v in (True, False))
    assert [b.name for b in scene.bodies] == [b.name for b in bare.bodies] and scene.instances and not bare.instances
    from nodes.physics.engines.mujoco_engine import MujocoEngine

    pose = MujocoEngine(bare).start().pose[0, 0]
    assert np.allclose(pose[0], se3.make_pose(np.array([0.1, 0, 0.05]), se3.IDENTITY[3:]))
    assert np.allclose(pose[1:, :3], [[0.1, 0, 0.55]] * 2)


def test_a_visual_that_cannot_be_read_leaves_the_collision_shape(robot):
    """With a note that says so; what MuJoCo cannot read at all is one line."""
    robot.write_text(URDF.replace('<box size="0.2 0.4 0.1"/>', '<mesh filename="package://r/gone.dae"/>'))
    scene = load_scene(str(robot))
    assert any("collision geometry of robot.urdf is drawn" in note and "gone.dae" in note for note in scene.notes)
    assert np.allclose(np.ptp(scene.instances[0].mesh.vertices[:, 2]), 0.6)
    robot.write_text(URDF.replace('<parent link="arm"/>', '<parent link="leg"/>'))
    with pytest.raises(SceneError, match=r"robot\.urdf") as caught:
        load_scene(str(robot))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "old, new, words",
    [
        ('<box size="0.2 0.4 0.1"/>', '<box size="${w} 0.4 0.1"/>', "${w} 0.4 0.1 in <box>"),
        ('<box size="0.2 0.4 0.1"/>', '<mesh filename="$(find arm)/arm.stl"/>', "$(find arm)/arm.stl in <mesh>"),
        ('<link name="base">', '<xacro:arm name="left"/><link name="base">', "<xacro:arm>"),
    ],
)
def test_xacro_that_is_not_expanded_is_refused(robot, old, new, words):
    """Of it MuJoCo reads a robot that lacks parts. What xacro has expanded still names its namespace, and is read."""
    from evis.config.paths import UnknownLaunch, find_launch

    text = URDF.replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ')
    robot.write_text(text)
    assert len(load_scene(str(robot)).instances) == 3
    robot.write_text(text.replace(old, new))
    with pytest.raises(SceneError) as caught:
        load_scene(str(robot))
    assert f"robot.urdf: {words} is xacro" in str(caught.value) and "`xacro robot.urdf > " in str(caught.value)
    source = robot.rename(robot.with_suffix(".urdf.xacro"))
    with pytest.raises(UnknownLaunch, match=r"robot\.urdf\.xacro has to be expanded first: `xacro "):
        find_launch(str(source))


def test_a_link_without_mass_is_told_what_it_needs(robot):
    """As many robots of ROS have them; the remedy is taken."""
    begin, end = URDF.index("<inertial>"), URDF.index("</inertial>") + len("</inertial>")
    solid = URDF.index("<collision><origin"), URDF.index("</collision>", URDF.index("<collision><origin"))
    text = URDF[:begin] + URDF[end : solid[0]] + URDF[solid[1] + len("</collision>") :]
    robot.write_text(text)
    with pytest.raises(SceneError, match=r"robot\.urdf: .*'arm'.* need an <inertial>.*boundmass") as caught:
        load_scene(str(robot))
    remedy = str(caught.value).partition("or ")[2].partition(" in the <robot>")[0]
    robot.write_text(text.replace("</robot>", f"{remedy}</robot>"))
    assert [body.name for body in load_scene(str(robot)).bodies] == ["arm", "tip", "cam0"]


def test_a_texture_that_is_not_drawn_is_told(robot):
    """MuJoCo reads the colours of a URDF's materials and leaves out their pictures."""
    assert not load_scene(str(robot)).notes
    robot.write_text(URDF.replace('<color rgba="0.5 0 1 1"/>', '<texture filename="wood.png"/>'))
    (note,) = load_scene(str(robot)).notes
    assert "textures of URDF materials are not drawn: wood.png" in note


def test_it_can_be_launched_by_its_path(robot):
    """A model in some folder is a scene for the simulator's graph, not a launch file."""
    from evis.config.paths import find_launch

    launch, arguments = find_launch(str(robot))
    assert launch.stem == "simulator" and arguments == {"scene": str(robot)}


TETRAHEDRON = """v 0 0 0
v 3 0 0
v 0 2 0
v 0 0 1
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""


@pytest.mark.parametrize(
    "how", ["above", "named", "beside", "ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH", "file", "relative"]
)
def test_meshes_are_found_as_ros_finds_them(tmp_path, monkeypatch, how):
    """The package above the URDF by its folder or by package.xml, beside it, or where the environment says."""
    for name in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(name, raising=False)
    package = {"above": "ws/my_robot", "named": "ws/checkout", "beside": "ws/my_robot"}.get(how, "else/share/my_robot")
    urdf = tmp_path / ("ws/other/urdf" if how == "beside" else f"{package}/urdf") / "r.urdf"
    if how.endswith("PATH"):
        urdf = tmp_path / "far" / "r.urdf"
        monkeypatch.setenv(how, str(tmp_path / ("else/share" if how.startswith("ROS") else "else")))
    mesh = tmp_path / package / "meshes" / "part.obj"
    for path in (urdf, mesh):
        path.parent.mkdir(parents=True, exist_ok=True)
    mesh.write_text(TETRAHEDRON)
    if not how.endswith("PATH"):
        (tmp_path / package / "package.xml").write_text("<package><name>my_robot</name></package>")
    called = {"file": f"file://{mesh}", "relative": "../meshes/part.obj"}.get(how, "package://my_robot/meshes/part.obj")
    shape = f'<geometry><mesh filename="{called}"/></geometry>'
    urdf.write_text(
        URDF.replace('<geometry><box size="0.2 0.4 0.1"/></geometry>', shape).replace(
            '<geometry><sphere radius="0.05"/></geometry>', shape
        )
    )
    scene, bare = load_scene(str(urdf)), load_scene(str(urdf), visuals=False)
    assert scene.notes == bare.notes == []
    seen = {(scene.bodies[i.body].name if i.body >= 0 else "world"): i for i in scene.instances}
    for name in ("world", "tip"):
        corners = np.unique(seen[name].mesh.vertices.round(5), axis=0)
        lengths = [np.linalg.norm(a - b) for i, a in enumerate(corners) for b in corners[:i]]
        assert np.allclose(sorted(lengths), np.sqrt([1, 4, 5, 9, 10, 13]), atol=1e-4)
    from nodes.physics.engines.mujoco_engine import MujocoEngine

    assert MujocoEngine(bare).model.nmesh == 1


def test_a_package_that_is_not_there_is_said_by_who_moves_and_by_who_draws(robot):
    robot.write_text(URDF.replace('<box size="0.2 0.4 0.1"/>', '<mesh filename="package://r/gone.dae"/>'))
    for visuals in (True, False):
        (note,) = load_scene(str(robot), visuals=visuals).notes
        assert "no file package://r/gone.dae; package 'r' is looked for above" in note and "ROS_PACKAGE_PATH" in note


def test_a_mesh_of_a_kind_that_mujoco_does_not_read_says_what_helps(robot, tmp_path):
    """COLLADA, as most robots of ROS have it: in a URDF the collision shapes are drawn, in an MJCF it is refused."""
    (tmp_path / "arm.dae").write_text("<COLLADA/>")
    robot.write_text(URDF.replace('<box size="0.2 0.4 0.1"/>', f'<mesh filename="{tmp_path / "arm.dae"}"/>'))
    (note,) = load_scene(str(robot)).notes
    mjcf = tmp_path / "arm.xml"
    mjcf.write_text('<mujoco><asset><mesh file="arm.dae"/></asset><worldbody/></mujoco>')
    with pytest.raises(SceneError) as refused:
        load_scene(str(mjcf))
    for told in (note, str(refused.value)):
        assert "arm.dae" in told and told.endswith("MuJoCo reads meshes as .obj and .stl; convert it to one of these")


def test_a_collision_mesh_that_is_not_there_is_an_error_of_the_scene(robot):
    robot.write_text(URDF.replace('<sphere radius="0.3"/>', '<mesh filename="package://r/gone.stl"/>'))
    with pytest.raises(SceneError, match=r"robot\.urdf: no file package://r/gone\.stl"):
        load_scene(str(robot))


@pytest.mark.parametrize("dirs", ['assetdir="parts"', 'meshdir="parts"', 'meshdir="parts" assetdir="nowhere"'])
def test_meshes_lie_where_mujoco_looks_for_them(robot, tmp_path, dirs):
    """A triangle mesh in a folder that the file's <compiler> names by either key, as a link's collision shape."""
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "t.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 2 0\nv 0 0 3\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    )
    text = URDF.replace('<sphere radius="0.05"/>', '<mesh filename="t.obj"/>')
    robot.write_text(text.replace("<link", f"<mujoco><compiler {dirs}/></mujoco><link", 1))
    scene = load_scene(str(robot))
    tip = next(i for i in scene.instances if i.name == "tip")
    assert not scene.notes and len(tip.mesh.faces) == 4
    edges = np.linalg.norm(np.diff(tip.mesh.vertices[tip.mesh.faces[:, [0, 1, 2, 0]]], axis=1), axis=-1)
    assert np.allclose(np.unique(edges.round(4)), np.sqrt([1, 4, 5, 9, 10, 13]).round(4))
