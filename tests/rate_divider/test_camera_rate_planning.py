"""The plan of a graph with cameras of several rates: who reads which states, and what is refused."""

from pathlib import Path
from typing import Any

import pytest

from evis.config import paths
from evis.config.document import LaunchError
from evis.launch.arguments import ArgumentError
from evis.launch.files import load
from evis.launch.planner import Options, plan_file, plan_target
from evis.runtime.plan import Plan
from evis.scene.load import camera_rates

SCENE = """
args: {slow: {default: 25, help: rate of the second camera, unit: Hz}}
cameras:
  cam0: {position: [0, -1, 0], look_at: [0, 0, 0], fov: 40 deg}
  cam1: {position: [0.1, -1, 0], look_at: [0, 0, 0], fov: 40 deg, rate: "${slow}"}
bodies: {ball: {shapes: [{shape: sphere, radius: 0.1}]}}
"""


@pytest.fixture
def scene(tmp_path: Path) -> str:
    path = tmp_path / "two_rates.yaml"
    path.write_text(SCENE)
    return str(path)


def plan(name: str, **given: Any) -> Plan:
    return plan_target(name, given, Options(view=False))


def readers(made: Plan, topic: str) -> list[str]:
    return sorted(edge.node for edge in made.topics[topic].edges)


def test_everything_of_a_slower_camera_reads_its_own_states() -> None:
    made = plan("stereo_room", camera_rate="right=10", labels="poses", imu="true")
    parts = ("audit", "imu", "interpolator", "labeler", "renderer")
    assert readers(made, "/right/state") == [f"{part}_right" for part in parts]
    assert readers(made, "/state") == sorted([*(f"{part}_left" for part in parts), "rate_divider_right"])
    assert made.nodes["rate_divider_right"].process == made.nodes["physics"].process
    rates = {name: node.params["keyframe_rate"] for name, node in made.nodes.items() if name.startswith("renderer")}
    assert rates == {"renderer_left": 30, "renderer_right": 10}
    assert made.args["camera_rate"] == ["right=10.0"]
    assert "rate_divider_left" in {item.what for item in made.left_out}


@pytest.mark.parametrize("given", [{}, {"camera_rate": "left=30,right=30"}])
def test_without_another_rate_nothing_is_divided(given: dict[str, str]) -> None:
    made = plan("stereo_room", **given)
    assert not [name for name in made.nodes if "divider" in name] and "/right/state" not in made.topics
    assert made.args["camera_rate"] == [] and "remap" not in made.launch_text


def test_dense_rendering_divides_the_frames_alike() -> None:
    made = plan("stereo_room", camera_rate="right=15", interpolator="none", upsampling="4")
    divider = made.nodes["rate_divider_right"].params
    assert (divider["keyframe_rate"], divider["rate"]) == (120, 60)
    assert made.nodes["physics"].params["keyframe_rate"] == 120
    assert made.nodes["renderer_right"].params["keyframe_rate"] == 60


def test_a_scene_gives_its_cameras_rates(scene: str) -> None:
    assert camera_rates(scene) == {"cam1": 25} and camera_rates("stereo_room") == {}
    given = {"scene": scene, "cameras": "cam0,cam1", "keyframe_rate": "50"}
    for more, divided in (({}, 25), ({"scene_args": "slow=10"}, 10), ({"camera_rate": "cam1=5"}, 5)):
        made = plan("simulator", **given, **more)
        assert made.nodes["rate_divider_cam1"].params["rate"] == divided
        assert made.args["camera_rate"] == [f"cam1={divided:.1f}"]
    for more in ({"cameras": "cam0"}, {"scene_args": "slow=50"}, {"camera_rate": "cam1=50"}):
        assert not [name for name in plan("simulator", **{**given, **more}).nodes if "divider" in name]


def test_a_file_that_sets_the_scenes_arguments_has_the_rates_that_follow(scene: str, tmp_path: Path) -> None:
    path = tmp_path / "outer.yaml"
    inner = paths.find_launch("simulator")[0]
    path.write_text(
        "args: {keyframe_rate: {default: 50}}\n"
        f"include: {{file: '{inner}', args: {{scene: '{scene}', scene_args: slow=10, cameras: [cam0, cam1]}}}}\n"
    )
    made = plan_file(path, {}, Options(view=False))
    assert made.nodes["rate_divider_cam1"].params["rate"] == 10 and made.args["camera_rate"] == ["cam1=10.0"]


def test_in_a_namespace_the_states_are_below_it(tmp_path: Path) -> None:
    path = tmp_path / "two.yaml"
    inner = paths.find_launch("simulator")[0]
    path.write_text(
        "include:\n" + "".join(f"  - {{file: '{inner}', namespace: {n}, args: {{scene: stereo_room, {a}}}}}\n"
            for n, a in (("one", "camera_rate: [left=15]"), ("two", "camera_rate: []")))
    )  # fmt: skip
    made = plan_file(path, {}, Options(view=False))
    assert readers(made, "/one/left/state")[:3] == ["one/audit_left", "one/imu_left", "one/interpolator_left"]
    assert "one/rate_divider_left" in readers(made, "/one/state") and "/two/left/state" not in made.topics


def test_the_resolved_launch_file_gives_the_same_graph(tmp_path: Path) -> None:
    made = plan("stereo_room", camera_rate="right=15")
    path = tmp_path / "resolved.yaml"
    path.write_text(made.launch_text)
    again = plan_file(path, {}, Options(view=False))
    assert again.topics == made.topics and again.nodes.keys() == made.nodes.keys()


@pytest.mark.parametrize(
    ("words", "part"),
    [
        ("right=20", "right: 20 Hz is no whole fraction of keyframe_rate, 30 Hz; the nearest are 15 and 30 Hz"),
        ("right=60", "the nearest is 30 Hz, and keyframe_rate:=60 would fit"),
        ("righ=15", "no camera 'righ' is simulated; did you mean 'right'?"),
        ("15", "'15' is not name=value, as in cam1=15"),
        ("right=slow", "'slow', must be a number above 0"),
        ("right=-1", "'-1', must be a number above 0"),
        ("right=nan", "'nan', must be a number above 0"),
        ("right=15,right=10", "right is given twice, as 15 and 10"),
    ],
)
def test_mistakes_are_one_clear_line(words: str, part: str) -> None:
    with pytest.raises(ArgumentError) as error:
        plan("stereo_room", camera_rate=words)
    assert part in str(error.value) and "camera_rate" in str(error.value) and "\n" not in str(error.value)


def test_the_nearest_rates_that_are_named_fit() -> None:
    with pytest.raises(LaunchError) as error:
        plan("stereo_room", camera_rate="right=30", keyframe_rate="100")
    assert "the nearest are 25 and 33.3333333333 Hz" in str(error.value)
    assert plan("stereo_room", camera_rate="right=33.3333333333", keyframe_rate="100").nodes["rate_divider_right"]
    assert plan("stereo_room", camera_rate="right=9.99", keyframe_rate="29.97").nodes["rate_divider_right"]


def test_a_scenes_rate_that_does_not_fit_names_the_scene_and_the_way_out(scene: str) -> None:
    with pytest.raises(LaunchError) as error:
        plan("simulator", scene=scene, cameras="cam0,cam1")
    text = str(error.value)
    assert "two_rates.yaml" in text and "cam1" in text and "25 Hz" in text and "camera_rate:=cam1=HZ" in text


@pytest.mark.parametrize("rate", ["0", "-5", "fast"])
def test_a_wrong_rate_in_a_scene_is_an_error_of_the_scene(rate: str, tmp_path: Path) -> None:
    from evis.scene import load_scene

    path = tmp_path / "wrong.yaml"
    path.write_text(SCENE.replace('"${slow}"', rate))
    with pytest.raises(ValueError, match=r"wrong\.yaml:5.*rate"):
        load_scene(str(path))


def test_auto_keeps_the_keyframe_rate_that_the_others_divide(monkeypatch: pytest.MonkeyPatch) -> None:
    from nodes.interpolator.auto import launch as auto
    from nodes.interpolator.auto.choice import Candidate
    from nodes.interpolator.auto.trial import Measured

    asked = []

    def measured(setting: Any, say: Any) -> tuple[Measured, bool]:
        asked.append((setting.keyframe_rate, setting.camera.name))
        return Measured([Candidate("rigid", setting.keyframe_rate, 4, 0.1, 0.01)]), True

    monkeypatch.setattr(auto, "measured", measured)
    launch = load(paths.find_launch("simulator")[0])
    for rates in ("right=15", "left=15"):
        wish = {"scene": "stereo_room", "interpolator": "auto", "camera_rate": rates}
        given, _ = auto.replace_auto(launch, wish, Options(duration_s=0.1), asked.append, asked.append)
        assert (given["keyframe_rate"], given["upsampling"], given["camera_rate"]) == (30, 4, rates)
    assert asked == [(30, "left"), (15, "left")]
