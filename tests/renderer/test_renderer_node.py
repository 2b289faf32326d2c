"""The node around the renderer: what it publishes, when, and what it says when it cannot."""

import numpy as np
import pytest
from node_bus import SIZE, start, state

from evis.scene import load_scene


@pytest.fixture(scope="module")
def disk():
    return load_scene("spinning_disk", SIZE)


def test_info_describes_the_camera_and_names_every_id(disk):
    _, bus = start("keyframe", margin=3, keyframe_rate=120)
    info = bus.take()["info"]
    assert (info.name, info.width, info.height, info.margin, info.envs) == ("cam0", 48, 36, 3, 1)
    assert info.keyframe_rate == 120
    np.testing.assert_array_equal(info.k, disk.cameras[0].k)
    assert info.instances == ["background", *(i.name for i in disk.instances)]
    assert info.instance_bodies[info.instances.index("disk")] == "disk"
    assert info.instance_bodies[info.instances.index("wall")] == ""


def test_only_what_is_read_is_published_and_all_of_one_instant(disk):
    node, bus = start("depth", "ids", margin=2)
    bus.take()
    node.update({"state": state(disk, 0.0, stamp=7)})
    sent = bus.take()
    assert set(sent) == {"depth", "ids"}
    assert all(m.header.stamp_ns == 7 and m.margin == 2 for m in sent.values())
    assert sent["depth"].depth.shape == (1, 40, 52)
    assert set(np.unique(sent["ids"].ids)) >= {1, 3}
    bus.wanted = {"keyframe", "depth", "motion", "ids", "normal"}
    node.update({"state": state(disk, 10.0, stamp=8)})
    assert set(bus.take()) == bus.wanted


def test_motion_starts_at_zero_in_every_episode_of_every_environment(disk):
    node, bus = start("motion", "ids", envs=2)

    def motions(*ms, episodes):
        node.update({"state": state(disk, *ms, episodes=episodes)})
        return [bool(m.any()) for m in bus.take()["motion"].motion]

    assert motions(0, 0, episodes=(0, 0)) == [False, False]
    assert motions(5, 5, episodes=(0, 0)) == [True, True]
    assert motions(0, 10, episodes=(1, 0)) == [False, True]
    assert motions(5, 15, episodes=(1, 0)) == [True, True]


def test_motion_is_that_of_the_disk(disk):
    """50 rad/s for 2 ms turn the plate by 0.1 rad about its centre: its speed grows linearly from there."""
    node, bus = start("motion", "ids")
    bus.take()
    for ms in (0.0, 2.0):
        node.update({"state": state(disk, ms)})
        sent = bus.take()
    speed = np.linalg.norm(sent["motion"].motion[0], axis=-1)
    plate = sent["ids"].ids[0] == 3
    assert not speed[~plate].any() and plate.sum() > 30
    # Seen from `standoff`, the rim of 0.15 m at 0.1 rad moves by at most 0.015 m times the focal length over its depth.
    assert 0.5 < speed[plate].max() / (0.015 * disk.cameras[0].k[0, 0] / 0.95) < 1.15


def test_keyframe_in_half_precision_and_lost_range_is_counted(disk):
    node, bus = start("keyframe", half=True)
    bus.take()
    node.update({"state": state(disk, 0.0)})
    radiance = bus.take()["keyframe"].radiance
    assert radiance.dtype == np.float16 and radiance.max() > 100 and not bus.counts
    node.renderer.shading.counts_later = lambda: lambda: (3, 2)
    node.update({"state": state(disk, 2.0)})
    assert bus.counts == {"nonfinite_pixels": 3, "clipped_pixels": 2}


def test_another_scenes_state_is_refused(disk):
    node, _ = start("keyframe")
    other = state(disk, 0.0)
    other.names = ["plate", "cam0"]
    with pytest.raises(ValueError, match="has bodies plate, cam0, scene spinning_disk has disk, cam0"):
        node.update({"state": other})


def test_a_pose_that_is_not_a_number_names_its_body(disk):
    node, _ = start("keyframe")
    broken = state(disk, 0.0)
    broken.end_pose[0, disk.body_index("disk"), 2] = np.nan
    with pytest.raises(ValueError, match="body 'disk' is not finite"):
        node.update({"state": broken})


def test_scene_arguments_and_cameras_are_checked():
    assert start(scene_args="omega=20,centre=0.1,0.2")[0].scene.name == "spinning_disk"
    with pytest.raises(ValueError, match="omeg"):
        start(scene_args="omeg=20")
    with pytest.raises(ValueError, match="no camera 'cam7'; it has cam0"):
        start(camera="cam7")


def test_what_is_not_drawn_is_told(tmp_path, monkeypatch):
    """A picture that a mesh names and that is not there; only who draws reads the mesh."""
    told = []
    monkeypatch.setattr("nodes.renderer.node.RendererNode.warn", lambda node, text, *rest: told.append(text))
    (tmp_path / "a.mtl").write_text("newmtl paint\nmap_Kd gone.png\n")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nusemtl paint\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    head = "cameras: {cam0: {fov: 1}}\nenvironment: 1\n"
    (tmp_path / "s.yaml").write_text(f"{head}world: [{{shape: mesh, file: a.obj}}]\n")
    start("depth", scene=str(tmp_path / "s.yaml"))
    assert told == ["scene s: a.obj names gone.png, which is not there; what it is for is drawn without"]


def test_what_the_first_look_finds_is_told_once(tmp_path, monkeypatch):
    """A camera that looks away from all there is."""
    told = []
    monkeypatch.setattr("nodes.renderer.node.RendererNode.warn", lambda node, text, *rest: told.append(text))
    camera = "cameras: {cam0: {fov: 1, look_at: [0, 1, 0]}}\nenvironment: 1\nmaterials: {grey: {albedo: 0.5}}\n"
    (tmp_path / "s.yaml").write_text(
        f"{camera}world: [{{shape: sphere, radius: 1, position: [0, -9, 0], material: grey}}]\n"
    )
    node, _ = start("depth", scene=str(tmp_path / "s.yaml"))
    for stamp in (0, 7):
        node.update({"state": state(load_scene(str(tmp_path / "s.yaml")), 0.0, stamp=stamp)})
    assert len(told) == 1 and "sees nothing at the start: 'world', the nearest" in told[0]
