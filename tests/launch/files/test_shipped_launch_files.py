"""The launch files that come with evis: what they run, what they leave out, and how a bag's run is repeated."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from evis.config import paths
from evis.config.document import LaunchError
from evis.launch.files import LaunchFile, load
from evis.launch.node_arguments import passed_on
from evis.launch.planner import Options, plan_file, plan_target
from evis.launch.target import read_target, scene_arguments
from evis.runtime.plan import Plan

STANDARD = {
    "scene": None, "seed": 0, "device": "cpu", "envs": 1, "width": 346, "height": 260, "keyframe_rate": 30,
    "upsampling": 8, "interpolator": "rigid", "threshold": None, "preset": "ideal",
}  # fmt: skip


def plan(name: str, options: Options | None = None, **given: Any) -> Plan:
    return plan_target(name, given, options or Options())


def left_out(made: Plan) -> dict[str, str]:
    return {item.what: item.why for item in made.left_out}


@pytest.mark.parametrize("name", ["simulator", "emulated_camera"])
def test_simulator_launch_files_take_the_standard_arguments(name: str) -> None:
    arguments = load(paths.find_launch(name)[0]).arguments
    for key, default in STANDARD.items():
        assert key in arguments and arguments[key].param.help, key
        if key != "scene":
            assert arguments[key].param.default == default
    assert arguments["scene"].required == (name == "simulator")


def test_spinning_disk_takes_the_papers_ranges() -> None:
    target = read_target("spinning_disk")
    arguments = scene_arguments(target.launch, target.given) | target.launch.arguments
    assert {"omega", "tilt", "centre", "standoff", "texture", "defocus"} <= arguments.keys()
    assert plan("spinning_disk").args["omega"] == 50, "what is not given is told too"
    made = plan("spinning_disk", omega="60", centre="0.1,-0.2", texture="3")
    texts = {n.params["scene_args"] for n in made.nodes.values() if "scene_args" in n.params}
    assert len(texts) == 1, "every node that loads the scene gets the same"
    assert made.args["omega"] == 60 and made.args["tilt"] == 35
    from evis.config.params import resolve
    from evis.scene.load import parse_args, scene_args

    values = resolve("scene", scene_args("spinning_disk"), parse_args(texts.pop()))
    assert (values["omega"], values["texture"]) == (60, 3)
    assert [float(v) for v in values["centre"]] == [0.1, -0.2]


def test_the_disk_leaves_out_what_it_does_not_need() -> None:
    made = plan("spinning_disk")
    out = left_out(made)
    assert {"mujoco", "labeler", "contacts", "/cam0/normal", "/cam0/ids", "recorder"} <= out.keys()
    assert all(out.values()), "every omission has a reason"
    assert made.nodes["labeler"].dormant
    groups = {process: [n.name for n in nodes] for process, nodes in made.processes().items()}
    assert groups.pop("sensor") == ["interpolator", "event_sensor", "audit"]
    assert groups == {name: [name] for name in ("physics", "renderer", "visualizer")}
    kinds = {(e.node, t.name): e.kind for t in made.topics.values() for e in t.edges}
    assert kinds[("interpolator", "/state")] == "lockstep"


def test_without_upsampling_there_is_no_interpolator() -> None:
    for given in ({"upsampling": "1"}, {"interpolator": "none"}):
        made = plan("spinning_disk", **given)
        assert "interpolator" not in made.nodes and "interpolator" in left_out(made)
        assert made.nodes["event_sensor"].inputs == {"keyframe": ["/cam0/keyframe"]}
        assert "/cam0/motion" in left_out(made)
    dense = plan("spinning_disk", interpolator="none", upsampling="10")
    assert dense.nodes["physics"].params["keyframe_rate"] == dense.nodes["renderer"].params["keyframe_rate"] == 300


def test_dynamics_load_mujoco_and_labels_start_the_labeler() -> None:
    made = plan("falling_objects", labels="contacts,depth")
    out = left_out(made)
    assert not {"mujoco", "contacts", "labeler"} & out.keys()
    assert made.nodes["physics"].params["contacts"] is True
    assert set(made.nodes["labeler"].inputs) == {"state", "depth"}
    assert made.nodes["labeler"].inputs["depth"] == ["/cam0/depth"]


def test_recording_counts_as_reading(tmp_path: Path) -> None:
    made = plan("spinning_disk", Options(record=str(tmp_path / "x.mcap"), view=False))
    topics = made.nodes["recorder"].inputs["messages"]
    assert {"/cam0/events", "/cam0/info", "/state", "/cam0/keyframe"} <= set(topics), "keyframes make the preview"
    assert not {"/cam0/labels", "/cam0/frames", "/cam0/normal"} & set(topics)
    assert "visualizer" in left_out(made)
    more = plan("spinning_disk", Options(record=str(tmp_path / "x.mcap"), record_topics=("/*/normal", "/*/labels")))
    assert {"/cam0/normal", "/cam0/labels"} <= set(more.nodes["recorder"].inputs["messages"])
    assert not more.nodes["labeler"].dormant


@pytest.mark.parametrize("name", ["spinning_disk", "camera", "replay"])
def test_the_recorder_syncs_where_it_is_told_to(tmp_path: Path, name: str) -> None:
    (tmp_path / "old.npz").touch()
    played = {"emulate": "davis346", "file": str(tmp_path / "old.npz")}
    given = {"camera": played, "replay": {"bag": str(tmp_path / "old.mcap")}}.get(name, {})
    if name == "replay":
        from evis.bag.writer import BagWriter
        from msgs.header import Header
        from msgs.world import Clock

        with BagWriter(given["bag"]) as writer:
            writer.write("/clock", Clock(Header(0, 0, "sim")))
    for sync in (False, True):
        made = plan(name, Options(record=str(tmp_path / "x.mcap"), record_sync=sync, view=False), **given)
        assert made.nodes["recorder"].params["sync"] is sync


def test_several_cameras_have_a_chain_each() -> None:
    with pytest.raises(LaunchError):
        plan("stereo_room", cameras="left,left")
    made = plan("stereo_room")
    assert {"renderer_left", "renderer_right", "event_sensor_right"} <= made.nodes.keys()
    assert {n.process for n in made.nodes.values() if n.name.endswith("sensor_right")} == {"sensor_right"}


EYE = "{position: [0, -2, 0], look_at: [0, 0, 0], fov: 40 deg}"


@pytest.mark.parametrize(
    ("cameras", "expected"),
    [
        (f"{{l: {EYE}, r: {EYE}}}", ["l", "r"]),
        (f"{{eye: {EYE}}}", ["cam0"]),
        (f"{{other: {EYE}, cam0: {EYE}}}", ["cam0"]),
        (f"{{eye: {{copies: {{over: {{k: 3}}}}, {EYE[1:]}}}", ["eye_0", "eye_1", "eye_2"]),
        (f"{{eye: {{copies: {{over: {{k: 3}}, if: '${{k == 1}}'}}, {EYE[1:]}}}", ["cam0"]),
        (f"{{cam0: {EYE}, eye: {{copies: {{over: {{k: 2}}}}, {EYE[1:]}}}", ["cam0"]),
    ],
)
def test_a_scene_of_ones_own_is_seen_by_its_cameras(tmp_path: Path, cameras: str, expected: list[str]) -> None:
    """All, where none is called cam0; the only one is, whatever its name in the file."""
    scene = tmp_path / "own.yaml"
    scene.write_text(f"cameras: {cameras}\nbodies: {{b: {{shapes: [{{shape: box, size: [1, 1, 1]}}]}}}}\n")
    made = plan("simulator", scene=str(scene))
    assert made.args["cameras"] == expected
    assert sorted(n.params["camera"] for n in made.nodes.values() if n.name.startswith("renderer")) == expected
    with pytest.raises(LaunchError, match="has no camera 'top'"):
        plan("simulator", scene=str(scene), cameras="top")


MODEL = "<mujoco><worldbody><body name='b'><freejoint/><geom size='0.1'/>{camera}</body></worldbody></mujoco>"


@pytest.mark.parametrize(
    ("cameras", "camera", "expected"),
    [
        (f"{{l: {EYE}, r: {EYE}}}", "", ["l", "r"]),
        (f"{{eye: {EYE}}}", "", ["cam0"]),
        (f"{{l: {EYE}, r: {EYE}}}", "<camera name='cam0'/>", ["l", "r"]),
        (f"{{other: {EYE}, cam0: {EYE}}}", "", ["cam0"]),
    ],
)
def test_so_is_one_with_a_model(tmp_path: Path, cameras: str, camera: str, expected: list[str]) -> None:
    """Whose own cameras count where the file has none; each that is taken is one that the renderer finds."""
    from evis.scene.load import load_scene

    (tmp_path / "model.xml").write_text(MODEL.format(camera=camera))
    scene = tmp_path / "own.yaml"
    scene.write_text(f"mjcf: model.xml\ncameras: {cameras}\n")
    assert plan("simulator", scene=str(scene)).args["cameras"] == expected
    assert set(expected) <= {camera.name for camera in load_scene(str(scene)).cameras}


@pytest.mark.parametrize(
    ("given", "part"),
    [
        ({"scene": "spining_disk"}, "the scene is given twice, as spinning_disk and scene:=spining_disk"),
        ({"omega": "1000"}, "the most is 70 rad/s"),
        ({"labels": "flw"}, "did you mean 'flow'?"),
        ({"interpolator": "splt"}, "did you mean 'splat'?"),
        ({"widht": "3"}, "did you mean 'width'?"),
    ],
)
def test_mistakes_are_found_before_anything_starts(given: dict[str, str], part: str) -> None:
    with pytest.raises(LaunchError) as error:
        plan("spinning_disk", **given)
    assert part in str(error.value)


def test_missing_recordings_and_bags_are_found_before_anything_starts(tmp_path: Path) -> None:
    (tmp_path / "take.raw").touch()
    with pytest.raises(LaunchError, match=r"take\.raw"):
        plan("camera", file=str(tmp_path / "tke.raw"))
    with pytest.raises(LaunchError, match="nowhere"):
        plan("replay", bag="nowhere.mcap")


def test_a_scene_is_launched_by_its_name() -> None:
    path, given = paths.find_launch("spinning_disk")
    assert (path.name, given) == ("simulator.yaml", {"scene": "spinning_disk"})
    assert plan("spinning_disk").name == "spinning_disk"
    with pytest.raises(LaunchError, match="no scene 'spining_disk'; did you mean 'spinning_disk'"):
        plan("simulator", scene="spining_disk")
    with pytest.raises(FileNotFoundError, match="did you mean 'spinning_disk'"):
        paths.find_launch("spinning_disc")


def test_planning_imports_no_engine() -> None:
    code = (
        "import sys, json; from evis.launch.planner import *;"
        "plan_target('falling_objects', {}, Options()); print(json.dumps(sorted(sys.modules)))"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert not {"warp", "mujoco", "aiohttp", "PIL", "OpenEXR", "usb", "mcap"} & set(json.loads(out))


def test_regeneration_takes_the_arguments_of_the_recorded_run(tmp_path: Path) -> None:
    import numpy as np

    from evis.bag.writer import BagWriter, describe_run
    from msgs.camera import CameraInfo, Keyframe
    from msgs.header import Header

    path = tmp_path / "run.mcap"
    stored = {
        "arg.upsampling": 5,
        "arg.threshold": 0.31,
        "arg.cameras": ["cam0"],
        "arg.device": "cuda:7",
        "arg.preset": "ideal",
    }
    writer = BagWriter(path, describe_run("", {}, **stored))
    writer.write("/cam0/info", CameraInfo(Header(0), np.eye(3), np.zeros(0), width=4, height=4))
    writer.write("/cam0/keyframe", Keyframe(Header(0), np.zeros(1, np.int32), np.ones((1, 4, 4, 3), np.float32)))
    writer.close()
    given = {"bag": str(path), "regenerate": "true", "interpolator": "none"}
    made = plan("replay", **given)
    assert made.args["upsampling"] == 5 and made.args["threshold"] == 0.31
    assert made.args["device"] == "cpu", "the machine is this one"
    assert made.nodes["event_sensor"].params["threshold"] == 0.31
    assert plan("replay", **given, threshold="0.4").args["threshold"] == 0.4


def test_what_a_method_needs_and_a_bag_lacks_is_told_with_how_to_record_it(tmp_path: Path) -> None:
    """Keyframes are enough for `none`, not for `splat`."""
    import numpy as np

    from evis.bag.writer import BagWriter
    from msgs.camera import Keyframe
    from msgs.header import Header

    path = tmp_path / "run.mcap"
    with BagWriter(path) as writer:
        writer.write("/cam0/keyframe", Keyframe(Header(0), np.zeros(1, np.int32), np.ones((1, 4, 4, 3), np.float32)))
    with pytest.raises(LaunchError, match=r"reads /cam0/depth, which nobody .*`--record-topics /cam0/depth`"):
        plan("replay", bag=str(path), regenerate="true", interpolator="splat", upsampling="4")


def test_two_worlds_run_side_by_side_in_namespaces(tmp_path: Path) -> None:
    include = paths.find_launch("simulator")[0]
    path = tmp_path / "two.yaml"
    path.write_text(
        "include:\n"
        + "".join(
            f"  - {{file: '{include}', namespace: {n}, args: {{scene: spinning_disk}}}}\n" for n in ("one", "two")
        )
    )
    made = plan(str(path))
    assert [e.node for e in made.topics["/two/state"].edges] == [
        "two/renderer", "two/interpolator", "two/audit", "two/labeler", "two/imu",
    ]  # fmt: skip
    assert {n.process for n in made.nodes.values()} >= {"one.physics", "two.physics", "one.sensor", "two.sensor"}


def passed(launch: LaunchFile, node: str) -> set[str]:
    """Parameters that a launch file gives to a node."""
    entry = launch.table["nodes"][node]
    scope = dict.fromkeys([*launch.arguments, *entry["foreach"]])
    return {*passed_on(entry, scope, node), *entry["params"]}


def test_replay_makes_frames_and_events_as_they_were_made() -> None:
    """It takes every argument of the simulator that changes them, and asks the bag for it."""
    simulator, replay = (load(paths.find_launch(name)[0]) for name in ("simulator", "replay"))
    for node in ("interpolator", "event_sensor"):
        ours, theirs = (passed(launch, node) for launch in (replay, simulator))
        assert ours == theirs, node
    methods = simulator.arguments["interpolator"].param.choices
    assert set(replay.arguments["interpolator"].param.choices) == {*methods} - {"auto"}
    here = {"bag", "regenerate", "pace", "start", "topics", "exclude", "again", "device", "threads", "batch"}
    assert set(replay.table["recorded"]["except"]) == here
    for name in replay.arguments.keys() - here:
        ours, theirs = replay.arguments[name].param, simulator.arguments[name].param
        assert (ours.type, ours.unit) == (theirs.type, theirs.unit), name


@pytest.mark.parametrize("name", ["simulator", "replay"])
def test_the_presets_are_all_named(name: str) -> None:
    from nodes.event_sensor.presets import PRESETS

    assert load(paths.find_launch(name)[0]).arguments["preset"].param.choices == tuple(PRESETS)


@pytest.mark.parametrize("name", ["simulator", "spinning_disk", "stereo_room"])
def test_a_preset_has_its_sensors_size(name: str) -> None:
    """Unless a size is given; --explain says where it comes from."""
    from evis.launch.explain import as_text
    from nodes.event_sensor.presets import PRESETS

    scene = {"scene": "spinning_disk"} if name == "simulator" else {}
    for preset, about in PRESETS.items():
        made = plan(name, preset=preset, **scene)
        size = (about.width, about.height) if about.width else (346, 260)
        renderers = [n for n in made.nodes.values() if n.target.endswith("RendererNode")]
        assert {(n.params["width"], n.params["height"]) for n in renderers} == {size}
        assert (made.args["width"], made.args["height"]) == size
        assert (f"width = {size[0]}  (preset:={preset} brings it)" in as_text(made)) == bool(about.width)
    given = plan(name, preset="dvs128", width=200, height=100, **scene)
    assert (given.args["width"], given.args["height"]) == (200, 100) and "brings it" not in as_text(given)


def test_a_preset_that_a_launch_file_sets(tmp_path: Path) -> None:
    """An include with the preset in its `args:` has the sensor's size too; a size of the file's own wins."""
    launch = tmp_path / "mine.yaml"
    (tmp_path / "disk.yaml").write_text("args: {scene: {default: spinning_disk}}\ninclude: simulator\n")
    launch.write_text("include: {file: disk.yaml, args: {preset: dvs128}}\n")
    made = plan_file(launch, {}, Options())
    assert made.nodes["renderer"].params["width"] == made.args["width"] == 128
    assert plan_file(launch, {"width": 90}, Options()).nodes["renderer"].params["width"] == 90
    launch.write_text("args: {width: {default: 64}}\ninclude: disk.yaml\n")
    made = plan_file(launch, {"preset": "dvs128"}, Options())
    params = made.nodes["renderer"].params
    assert (params["width"], params["height"]) == (64, 128)


def test_what_nobody_in_the_graph_gives_a_program_outside_may() -> None:
    """Physics takes actions and resets, and no other node takes anything."""
    physics = plan("spinning_disk").nodes["physics"]
    assert physics.outside == {"action": "/action", "reset": "/reset"} and "action" not in physics.inputs
    assert not any(node.outside for name, node in plan("spinning_disk").nodes.items() if name != "physics")


def test_what_is_decided_at_the_start_is_not_promised_to_who_comes_later() -> None:
    """The page offered /cam0/samples, and `evis topic echo` waited for it, where nothing would ever come."""
    from evis.client.running import check_topic

    made = plan("spinning_disk")
    for topic in ("/cam0/samples", "/cam0/signal"):
        assert topic not in made.open_topics() and "from the start" in left_out(made)[topic]
        with pytest.raises(ValueError, match=f"the graph does not make {topic}: nobody reads it from the start"):
            check_topic(made, topic)
    assert "/cam0/frames" in made.open_topics()
    assert "/cam0/samples" in plan("spinning_disk", time_tolerance=0.0003).topics
    assert "/cam0/signal" in plan("spinning_disk", labels="events").topics
    recorded = plan("spinning_disk", Options(record=Path("a.mcap"), record_topics=("/cam0/signal",)))
    assert "/cam0/signal" in recorded.topics
