"""Numbers that a MuJoCo model brings: texture coordinates of its meshes, sensors with a size, lights without units."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from evis.scene import SceneError, load_scene

CORNERS = [(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
TEXCOORDS = [(0.1, 0.2), (0.9, 0.25), (0.8, 0.7), (0.15, 0.6), (0.5, 0.9)]
FACES = [(1, 3, 2), (1, 4, 3), (1, 2, 5), (2, 3, 5), (3, 4, 5), (4, 1, 5)]
"""A pyramid, with a texture coordinate to every vertex; OBJ counts from 1."""


def load(folder: Path, text: str, **arguments):
    path = folder / "model.xml"
    path.write_text(f"<mujoco>{text}</mujoco>")
    return load_scene(str(path), arguments)


def test_a_mesh_is_textured_as_its_obj_says(tmp_path: Path) -> None:
    """(u, v) of OBJ, v upwards, whatever way MuJoCo counts."""
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS] + [f"vt {u} {v}" for u, v in TEXCOORDS]
    lines += ["f " + " ".join(f"{k}/{k}" for k in face) for face in FACES]
    (tmp_path / "pyramid.obj").write_text("\n".join(lines))
    scene = load(
        tmp_path,
        """<asset><texture name="t" type="2d" builtin="checker" width="8" height="8"/><material name="m" texture="t"/>
        <mesh name="pyramid" file="pyramid.obj" inertia="legacy"/></asset>
        <worldbody><geom type="mesh" mesh="pyramid" material="m"/></worldbody>""",
    )
    instance = next(i for i in scene.instances if len(i.mesh.faces) == len(FACES))
    assert instance.mesh.uv is not None
    found, said = (np.unique(np.round(uv, 5), axis=0) for uv in (instance.mesh.uv.reshape(-1, 2), np.array(TEXCOORDS)))
    np.testing.assert_allclose(found, said, atol=1e-5)


def test_a_sensors_size_and_focal_length_make_the_intrinsics(tmp_path: Path) -> None:
    """f [px] = f [m] / pixel pitch [m], of each axis its own."""
    scene = load(
        tmp_path,
        """<worldbody><camera name="eye" pos="0 0 1" resolution="400 200" sensorsize="0.008 0.003" focal="0.006 0.004"/>
        <geom size="0.1"/></worldbody>""",
        width=400,
        height=200,
    )
    k = scene.cameras[0].k
    assert k[0, 0] == pytest.approx(0.006 / (0.008 / 400), rel=1e-6)
    assert k[1, 1] == pytest.approx(0.004 / (0.003 / 200), rel=1e-6)


@pytest.mark.parametrize("principal", ['principal=".001 .0005"', 'principalpixel="-7 12"'])
def test_a_principal_point_is_where_mujocos_own_pictures_have_it(principal: str, tmp_path: Path) -> None:
    """Against the frustum that MuJoCo gives to OpenGL: its edges lie half a pixel beyond the outermost centres."""
    eye = f'<camera name="eye" pos="0 0 1" resolution="64 48" focal=".004 .005" sensorsize=".0064 .0048" {principal}/>'
    scene = load(tmp_path, f'<worldbody>{eye}<geom size="0.1"/></worldbody>', width=64, height=48)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    data, seen, view = mujoco.MjData(model), mujoco.MjvScene(model, 10), mujoco.MjvCamera()
    mujoco.mj_forward(model, data)
    view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, view, mujoco.mjtCatBit.mjCAT_ALL, seen)
    edges, k = seen.camera[0], scene.cameras[0].k
    left = (edges.frustum_center - edges.frustum_width) / edges.frustum_near
    right = (edges.frustum_center + edges.frustum_width) / edges.frustum_near
    top, bottom = -edges.frustum_top / edges.frustum_near, -edges.frustum_bottom / edges.frustum_near
    found = [k[0, 0] * left + k[0, 2], k[0, 0] * right + k[0, 2], k[1, 1] * top + k[1, 2], k[1, 1] * bottom + k[1, 2]]
    # The frustum is in float32.
    np.testing.assert_allclose(found, [-0.5, 63.5, -0.5, 47.5], atol=1e-4)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('<worldbody><camera name="eye" fovy="0"/></worldbody>', "camera 'eye' has fovy 0; it must be"),
        ('<worldbody><camera name="eye" fovy="-20"/></worldbody>', "camera 'eye' has fovy -20; it must be"),
        ('<worldbody><camera fovy="nan"/></worldbody>', "camera 'camera0' has fovy nan; it must be"),
        ('<visual><global fovy="0"/></visual><worldbody/>', "<visual><global> has fovy 0; it must be"),
        (
            '<worldbody><camera name="eye" resolution="4 4" sensorsize=".01 .01"/></worldbody>',
            "camera 'eye' has focal lengths 0 and 0 px",
        ),
    ],
)
def test_a_field_of_view_that_no_camera_has_is_refused(text: str, says: str, tmp_path: Path) -> None:
    """In one line with file, camera and value."""
    with pytest.raises(SceneError, match=f"^model.xml: {says}") as caught:
        load(tmp_path, text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("height", [1.0, 3.0])
def test_a_point_light_makes_a_white_surface_at_the_centre_as_bright_as_its_diffuse(
    height: float, tmp_path: Path
) -> None:
    """Lambert: radiance = albedo / pi * intensity / distance^2, facing the light."""
    scene = load(
        tmp_path,
        f"""<statistic center="0 0 0.5" extent="2"/><worldbody>
        <light name="bulb" type="point" pos="0 0 {height}" diffuse="0.8 0.6 0.4"/><geom size="0.1"/></worldbody>""",
    )
    light = next(one for one in scene.lights if one.name == "bulb")
    assert light.kind == "point"
    np.testing.assert_allclose(light.colour / np.pi / (height - 0.5) ** 2, [0.8, 0.6, 0.4], rtol=1e-6)


@pytest.mark.parametrize("timestep", ["0", "-0.001", "9e-8", "nan", "1e300"])
def test_a_timestep_that_nothing_can_be_stepped_with_is_refused(timestep: str, tmp_path: Path) -> None:
    """In one line with file and value, when the scene is loaded."""
    with pytest.raises(SceneError, match=f"^model.xml: <option> has timestep {float(timestep):g}".replace("+", r"\+")):
        load(tmp_path, f'<option timestep="{timestep}"/><worldbody><geom size="1"/></worldbody>')


def test_the_shortest_timestep_is_taken(tmp_path: Path) -> None:
    load(tmp_path, '<option timestep="1e-7"/><worldbody><geom size="1"/></worldbody>')


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ('<body name="b" pos="0 0 0">|<body name="b" pos="nan 0 0">', "body 'b' has a pos"),
        ('<camera name="c" pos="0 0 1"|<camera name="c" pos="0 nan 1"', "camera 'c' has a pos"),
        ('<light name="l" pos="0 0 1"|<light name="l" pos="0 0 nan"', "light 'l' has a pos"),
        ('qpos="0"|qpos="nan"', "key 'home' has a qpos"),
        ('qvel="0"|qvel="inf"', "key 'home' has a qvel"),
        ('ctrl="0"|ctrl="nan"', "key 'home' has a ctrl"),
    ],
)
def test_a_number_that_is_none_is_refused_where_it_stands(change: str, says: str, tmp_path: Path) -> None:
    """In one line with file and element, whatever would come of it."""
    text = """<worldbody><light name="l" pos="0 0 1"/><camera name="c" pos="0 0 1"/><body name="b" pos="0 0 0">
    <joint name="j"/><geom size="1"/></body></worldbody><actuator><motor joint="j"/></actuator>
    <keyframe><key name="home" qpos="0" qvel="0" ctrl="0"/></keyframe>"""
    load(tmp_path, text)
    with pytest.raises(SceneError, match=f"^model.xml: {says} that is not finite"):
        load(tmp_path, text.replace(*change.split("|")))
