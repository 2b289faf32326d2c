"""Cameras and lights of a MuJoCo model that track a body or look at one: which frames a scene has for them."""

import mujoco
import numpy as np
import pytest

from evis.geometry import se3
from evis.scene import load_scene
from evis.scene.model import WORLD

BODIES = """
<body name="post" pos="1 0 0"><geom size="0.1"/>{post}</body>
<body name="ball" pos="0 2 1"><freejoint/><geom size="0.1"/>{ball}</body>
"""


@pytest.fixture
def scene_of(tmp_path):
    def make(world="", post="", ball=""):
        path = tmp_path / "m.xml"
        path.write_text(f"<mujoco><worldbody>{BODIES.format(post=post, ball=ball)}{world}</worldbody></mujoco>")
        model = mujoco.MjModel.from_xml_path(str(path))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        return load_scene(str(path)), data

    return make


@pytest.mark.parametrize("mode", ["track", "trackcom", "targetbody", "targetbodycom"])
def test_a_camera_that_follows_is_a_frame_of_its_own(scene_of, mode):
    """Moved by the engine under the camera's number; the first camera of the model is cam0."""
    target = 'target="ball"' if "target" in mode else ""
    scene, _ = scene_of(ball=f'<camera name="chase" mode="{mode}" {target} pos="0 -3 1"/><camera name="eye"/>')
    assert [c.name for c in scene.cameras] == ["cam0", "eye"] and not scene.notes
    body = scene.bodies[scene.body_index("cam0")]
    assert body.follows == ("camera", 0) and body.trajectory is None and body.mount is None
    assert scene.bodies[scene.body_index("eye")].mount[0] == 1


@pytest.mark.parametrize("mode", ['mode="track"', 'mode="targetbody" target="post"'])
def test_what_follows_something_that_stands_still_needs_no_engine(scene_of, mode):
    """The pose is MuJoCo's, and static."""
    scene, data = scene_of(world=f'<camera name="c" pos="0 -3 1" {mode}/><body name="ball2"/>')
    trajectory = scene.bodies[scene.body_index("cam0")].trajectory
    assert trajectory.is_static()
    pose = trajectory.pose(np.zeros(1, np.int64))[0]
    assert np.abs(pose[:3] - data.cam_xpos[0]).max() < 1e-12
    forward = se3.rotate(pose[3:], np.array([0.0, 0.0, 1.0]))
    assert np.abs(forward + data.cam_xmat[0].reshape(3, 3)[:, 2]).max() < 1e-12


def test_a_centre_of_mass_moves_with_the_bodies_that_hang_on_it(scene_of):
    """trackcom of the world follows all that moves, though the world does not."""
    scene, _ = scene_of(world='<camera name="c" pos="0 -3 1" mode="trackcom"/>')
    assert scene.bodies[scene.body_index("cam0")].follows == ("camera", 0)


def test_only_lights_that_need_it_have_a_frame(scene_of):
    """A directional light that tracks shines one way; a bulb that looks at something is where its body is."""
    scene, data = scene_of(
        ball='<light name="sun" mode="track" type="directional" dir="1 0 -1"/>'
        '<light name="bulb" mode="targetbody" target="post" type="point" pos="0 0 2"/>'
        '<light name="lamp" mode="trackcom" pos="0 0 3" dir="0 1 -1"/>'
        '<light name="look" mode="targetbodycom" target="post" pos="0 0 3"/>',
        post='<light name="fixed" mode="targetbody" target="post" pos="0 1 1"/>',
    )
    lights = {light.name: light for light in scene.lights}
    assert lights["sun"].body == WORLD and np.allclose(lights["sun"].vector, np.array([1, 0, -1]) / np.sqrt(2))
    assert lights["bulb"].body == 1 and np.allclose(lights["bulb"].vector, [0, 0, 2])
    assert lights["fixed"].body == WORLD and np.allclose(lights["fixed"].vector, [1, 1, 1])
    assert np.allclose(lights["fixed"].direction, np.array([0, -1, -1]) / np.sqrt(2))
    numbers = {scene.bodies[light.body].name: scene.bodies[light.body].follows for light in lights.values()}
    names = [mujoco.mj_id2name(data.model, mujoco.mjtObj.mjOBJ_LIGHT, i) for i in range(data.model.nlight)]
    assert numbers["lamp"] == ("light", names.index("lamp")) and numbers["look"] == ("light", names.index("look"))
    assert [body.name for body in scene.bodies if body.follows] == ["lamp", "look"]


def test_those_who_need_no_picture_have_the_same_bodies(scene_of, tmp_path):
    """Physics loads a scene without what is seen: body n must be body n."""
    scene_of(ball='<light name="ball" mode="track"/><camera name="ball" mode="trackcom"/>')
    seen, unseen = (load_scene(str(tmp_path / "m.xml"), visuals=v).bodies for v in (True, False))
    assert [(b.name, b.follows) for b in seen] == [(b.name, b.follows) for b in unseen]
    assert [b.name for b in seen] == ["post", "ball", "cam0", "ball_light"]


def test_a_link_called_cam0_gives_way_to_the_first_camera(tmp_path):
    """Its instances stay its own."""
    (tmp_path / "m.xml").write_text(
        """<mujoco><worldbody><body name="cam0"><freejoint/><geom name="case" size="0.1"/><camera name="cam0"/></body>
        </worldbody></mujoco>"""
    )
    scene = load_scene(str(tmp_path / "m.xml"))
    assert [body.name for body in scene.bodies] == ["cam0_body", "cam0"] and scene.cameras[0].name == "cam0"
    assert scene.bodies[1].mount[0] == 0 and scene.instances[0].body == 0


def test_names_of_cameras_fit_into_topics(scene_of):
    """Attached models have a / in their names; two that become alike stay apart."""
    scene, _ = scene_of(world='<camera name="a"/><camera name="arm/eye"/><camera name="arm eye"/>')
    assert [camera.name for camera in scene.cameras] == ["cam0", "arm_eye", "arm_eye_camera"]


@pytest.mark.parametrize("distance", [1.0, 4.0])
def test_attenuation_counts_at_the_centre(tmp_path, distance):
    """Radiance of a white surface at the centre that faces the light: diffuse / (a + b D + c D^2), as in MuJoCo."""
    (tmp_path / "m.xml").write_text(
        f"""<mujoco><statistic center="0 0 0" extent="1"/><worldbody><geom size="0.1"/>
        <light type="point" pos="0 0 {distance}" attenuation="0.5 0.25 0.125" diffuse="0.6 0.6 0.6"/>
        </worldbody></mujoco>"""
    )
    light = load_scene(str(tmp_path / "m.xml")).lights[0]
    wanted = 0.6 / (0.5 + 0.25 * distance + 0.125 * distance**2)
    assert np.allclose(light.colour / np.pi / distance**2, wanted, rtol=1e-6)


def test_a_light_that_is_an_image_is_left_out_and_noted(tmp_path):
    """It has no place and no colour."""
    (tmp_path / "m.xml").write_text(
        """<mujoco><asset><texture name="t" type="cube" builtin="flat" width="4" height="4"/></asset><worldbody>
        <light name="room" type="image" texture="t"/><geom size="0.1"/></worldbody></mujoco>"""
    )
    scene = load_scene(str(tmp_path / "m.xml"))
    assert [light.name for light in scene.lights] == ["headlight"]
    assert any("'room' is left out" in note for note in scene.notes)
