"""Scene files: what they may say, and the one line that a mistake gives."""

import numpy as np
import pytest

from evis.geometry import pinhole, se3
from evis.scene import SceneError, load_scene, scene_args
from evis.scene.load import camera_rates, is_dynamic, parse_args, starts_at_random

GOOD = """
args:
  rate: {default: 20, min: 1, max: 40, unit: rad/s, help: how fast it turns}
  where: {type: vector, default: [0, 0, 2], help: position}
cameras:
  cam0: {fov: 60 deg}
  side: {width: 64, height: 48, focal: 50, position: [1, 0, 2], look_at: "${where}", up: [0, -1, 0]}
materials:
  grey: {albedo: 0.5}
bodies:
  top:
    position: ${where}
    motion: {kind: spin, axis: [0, 0, 2], rate: "${rate}"}
    shapes: [{shape: sphere, radius: 0.1, material: grey}, {name: rod, shape: disk, radius: 1, material: grey}]
lights:
  sun: {kind: directional, irradiance: [1, 2, 3], direction: [0, 0, 2]}
environment: 0.1
"""


@pytest.fixture
def scene_file(tmp_path):
    def write(text=GOOD, *edits):
        for old, new in edits:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "toy.yaml"
        path.write_text(text)
        return str(path)

    return write


def test_everything_is_where_the_file_says(scene_file):
    """Bodies, cameras, instances and lights, with arguments at their defaults and overridden."""
    scene = load_scene(scene_file())
    assert [b.name for b in scene.bodies] == ["top", "cam0", "side"]
    assert [i.name for i in scene.instances] == ["top_0", "rod"]
    assert [(c.name, c.width, c.height) for c in scene.cameras] == [("cam0", 346, 260), ("side", 64, 48)]
    assert np.isclose(scene.cameras[0].k[0, 0], 130 / np.tan(np.radians(30)))
    assert scene.cameras[1].k.tolist() == [[50, 0, 31.5], [0, 50, 23.5], [0, 0, 1]]
    assert np.allclose(scene.lights[0].vector, [0, 0, 1]) and scene.lights[0].colour.tolist() == [1, 2, 3]
    assert np.allclose(scene.environment, 0.1) and not scene.dynamic

    scene = load_scene(scene_file(), {"rate": "30", "where": "0,1,3", "width": 100})
    assert scene.bodies[0].trajectory.pose(np.zeros(1, np.int64))[0, :3].tolist() == [0, 1, 3]
    assert scene.bodies[0].trajectory.twist(np.zeros(1, np.int64))[0].tolist() == [0, 0, 0, 0, 0, 30]
    assert scene.cameras[0].width == 100 and scene.cameras[1].width == 64


@pytest.mark.parametrize(
    "old, new, line, words",
    [
        ("radius: 0.1,", "radios: 0.1,", 14, "shape 1 needs 'radius'"),
        ("radius: 0.1,", "radius: .nan,", 14, "radius is nan; it must be a finite number"),
        ("radius: 0.1,", "radius: -1,", 14, "radius is -1; it must be more than 0"),
        ("radius: 0.1,", "radius: 0.1, radios: 1,", 14, "radios is not known here; did you mean 'radius'?"),
        ("shape: sphere", "shape: spere", 14, "shape is 'spere'; did you mean 'sphere'?"),
        ("material: grey}, {", "material: gray}, {", 14, "material is 'gray'; did you mean 'grey'?"),
        ("kind: spin", "kind: spinn", 13, "kind is 'spinn'; did you mean 'spin'?"),
        ("axis: [0, 0, 2]", "axis: [0, 0, 0]", 13, "axis is zero, so it has no direction"),
        ("axis: [0, 0, 2]", "axis: [0, 2]", 13, "axis is [0, 2]; it must be a list of 3 numbers"),
        ('rate: "${rate}"', 'rate: "${rat}"', 13, "rate uses 'rat'; did you mean 'rate'?"),
        ('rate: "${rate}"', 'rate: "${1 / 0}"', 13, "divides by zero"),
        ("fov: 60 deg", "fov: 180 deg", 6, "must lie between 0 and 180 deg"),
        (
            "fov: 60 deg",
            "fov: 40",
            6,
            "fov is 40 rad; it must lie between 0 and 180 deg; degrees are written as in `40 deg`",
        ),
        ("position: [1, 0, 2]", "position: [1, 1.0e300, 2]", 7, "position is 1e+300; the most is 1e+09"),
        (
            'kind: spin, axis: [0, 0, 2], rate: "${rate}"',
            "kind: swing, axis: [0, 0, 2], amplitude: 1, frequency: 1.0e12",
            13,
            "frequency is 1e+12; the most is 1e+06",
        ),
        ("irradiance: [1, 2, 3]", "irradiance: 1.0e40", 16, "irradiance is 1e+40; the most is 1e+30"),
        ("fov: 60 deg", "near: 1", 6, "camera 'cam0' needs 'fov'"),
        ("fov: 60 deg", "fov: .inf", 6, "fov is inf; it must be a finite number"),
        ("focal: 50", "focal: 50, fov: 1", 7, "focal and fov are given; leave one out"),
        ("albedo: 0.5", "albedo: 1.5", 9, "albedo is 1.5; the most is 1, since it is a reflectance"),
        ("albedo: 0.5", "albedo: -0.5", 9, "albedo is -0.5; the least is 0"),
        ("position: ${where}", "position: ${where}\n    parent: tip", 13, "parent is 'tip'; did you mean 'top'?"),
        ("position: ${where}", "quaternion: [0, 0, 1]", 12, "quaternion is [0, 0, 1]; it must be a list of 4 numbers"),
        ("position: ${where}", "quaternion: [0, 0, 0, 0]", 12, "quaternion is zero, so it is no rotation"),
        ("position: ${where}", "parent: top", 12, "leads back to the body itself"),
        ("position: ${where}", "view: {camera: cam1, depth: 1}", 12, "camera is 'cam1'; did you mean 'cam0'?"),
        ("environment: 0.1", "environmen: 0.1", 17, "environmen is not known here; did you mean 'environment'?"),
        ("lights:", "mjcf: robot.xml\nlights:", 15, "names robot.xml, which is not in"),
        ("bodies:", "bodies:\n  cam0: {}", 6, "has a name that is taken already"),
        ("kind: directional", "kind: sopt", 16, "kind is 'sopt'; did you mean 'spot'?"),
        ("up: [0, -1, 0]", "up: [-1, 0, 0]", 7, "looks along 'up'"),
        ("rate: {default: 20", "rate: {default: 99", 3, "rate is 99.0 rad/s, the most is 40 rad/s"),
        ("rate: {default: 20", "rate: {defualt: 20", 3, "argument 'rate' needs 'default'"),
        ("rate: {default: 20", "rate: {default: 20, choices: 20", 3, "choices is 20; it must be a list of values"),
        ("unit: rad/s", "type: str, choices: abc", 3, "choices is 'abc'; it must be a list of values"),
    ],
)
def test_a_mistake_names_file_line_key_and_remedy(scene_file, old, new, line, words):
    """One line of text each, at the line where the mistake stands."""
    with pytest.raises(ValueError) as caught:
        load_scene(scene_file(GOOD, (old, new)))
    text = str(caught.value)
    assert f"toy.yaml:{line}" in text and words in text and "\n" not in text and text.count("toy.yaml") == 1, text


def test_what_only_loading_refuses_is_passed_over_before_it(scene_file):
    """A camera or a start that is no map: who asks for rates and random starts alone loads nothing."""
    path = scene_file("cameras: {cam0: 3}\nmjcf: m.xml\ninitial_joints: {slide: 3}\ninitial_spread: 3\n")
    assert camera_rates(path) == {} and starts_at_random(path) == ()
    with pytest.raises(SceneError, match=r"toy\.yaml:\d: .*"):
        load_scene(path)


def test_wrong_arguments(scene_file):
    """Names and ranges come from the scene's own declaration."""
    path = scene_file()
    with pytest.raises(ValueError, match=r"scene toy has no parameter 'rte'; did you mean 'rate'"):
        load_scene(path, {"rte": 1})
    with pytest.raises(ValueError, match=r"rate is 50\.0 rad/s, the most is 40 rad/s"):
        load_scene(path, {"rate": "50"})
    with pytest.raises(ValueError, match=r"where is .* must be 3 numbers"):
        load_scene(path, {"where": "1,2"})
    with pytest.raises(ValueError, match=r"where\[1\] is nan; it must be finite"):
        load_scene(path, {"where": "1,nan,2"})
    with pytest.raises(ValueError, match="width is 0 px, the least is 1 px"):
        load_scene(path, {"width": 0})
    assert set(scene_args(path)) == {"width", "height", "rate", "where"}


@pytest.mark.parametrize(
    "text", ["", "- a\n- b\n", "cameras: [", "cameras: {cam0: {fov: 1}}\ncameras: {}\n", "\x00\x01", "a: &a [*a]"]
)
def test_what_is_no_scene_is_one_clear_error(tmp_path, text):
    """Empty, a list, broken YAML, a key twice, binary, an alias to itself: no traceback of the YAML reader."""
    path = tmp_path / "bad.yaml"
    path.write_bytes(text.encode())
    with pytest.raises(SceneError, match=r"bad\.yaml"):
        load_scene(str(path))


def test_missing_scene_names_the_nearest():
    """The scenes that come with evis are offered."""
    with pytest.raises(FileNotFoundError, match=r"no scene 'spining_disk'; did you mean 'spinning_disk'"):
        load_scene("spining_disk")
    with pytest.raises(FileNotFoundError, match="no scene"):
        load_scene("nowhere/else.yaml")


def test_a_scene_without_camera_says_so(scene_file):
    """Nothing can be seen without one."""
    with pytest.raises(SceneError, match="has no camera"):
        load_scene(scene_file("environment: 1\n"))


def test_the_only_camera_is_cam0(scene_file):
    """Whatever the file calls it; several keep their names."""
    scene = load_scene(scene_file("cameras: {eye: {fov: 1}}\n"))
    assert [c.name for c in scene.cameras] == [b.name for b in scene.bodies] == ["cam0"]
    scene = load_scene(scene_file("cameras: {left: {fov: 1}, right: {fov: 1, parent: left, position: [0.1, 0, 0]}}\n"))
    assert [c.name for c in scene.cameras] == [b.name for b in scene.bodies] == ["left", "right"]


def test_a_body_is_placed_in_the_view(scene_file):
    """Its origin projects to the asked fraction of the frame, at the asked depth, for any image size."""
    text = GOOD.replace("position: ${where}", "view: {camera: cam0, offset: [0.25, -0.1], depth: 3}")
    text = text.replace("cam0: {fov: 60 deg}", "cam0: {fov: 60 deg, position: [1, 2, 3], look_at: [2, 5, 1]}")
    for size in ({}, {"width": 640, "height": 480}):
        scene = load_scene(scene_file(text), size)
        body, camera = (scene.bodies[i].trajectory.pose(np.zeros(1, np.int64))[0] for i in (0, 1))
        local = se3.transform(se3.inverse(camera), body[:3])
        c = scene.cameras[0]
        x, y = pinhole.project(c.k, local)
        assert np.isclose(local[2], 3.0)
        assert np.allclose([(x + 0.5) / c.width - 0.5, (y + 0.5) / c.height - 0.5], [0.25, -0.1])


@pytest.mark.parametrize("model", ["plumb_bob", "equidistant"])
def test_a_body_is_placed_in_the_view_of_a_lens(scene_file, model):
    """OpenCV's formulas give the asked fraction of the frame; a place that the lens does not see is told."""
    k = [-0.1, 0.0, 0.01, -0.02] if model == "plumb_bob" else [0.03, -0.01, 0.002, 0.0]
    lens = f"fov: 80 deg, distortion: {{model: {model}, coefficients: {k}}}"
    text = GOOD.replace("position: ${where}", "view: {camera: cam0, offset: [0.3, -0.25], depth: 3}")
    text = text.replace("fov: 60 deg", f"{lens}, position: [1, 2, 3], look_at: [2, 5, 1]")
    scene = load_scene(scene_file(text))
    body, camera = (scene.bodies[i].trajectory.pose(np.zeros(1, np.int64))[0] for i in (0, 1))
    local = se3.transform(se3.inverse(camera), body[:3])
    a, b = local[:2] / local[2]
    s = a * a + b * b
    if model == "plumb_bob":
        k1, k2, p1, p2 = k
        g = 1 + k1 * s + k2 * s * s
        u, v = a * g + 2 * p1 * a * b + p2 * (s + 2 * a * a), b * g + p1 * (s + 2 * b * b) + 2 * p2 * a * b
    else:
        theta = np.arctan(np.sqrt(s))
        bent = theta * (1 + k[0] * theta**2 + k[1] * theta**4 + k[2] * theta**6)
        u, v = bent / np.sqrt(s) * np.array([a, b])
    c = scene.cameras[0]
    pixel = np.array([c.k[0, 0] * u + c.k[0, 2], c.k[1, 1] * v + c.k[1, 2]])
    assert np.isclose(local[2], 3.0)
    assert np.allclose((pixel + 0.5) / [c.width, c.height] - 0.5, [0.3, -0.25])
    with pytest.raises(SceneError, match=r"offset is \[5.0, 0.0\], where 'cam0' sees nothing ahead"):
        load_scene(scene_file(text.replace("[0.3, -0.25]", "[5, 0]")))


def test_scene_args_text():
    """A comma separates arguments and the components of one."""
    assert parse_args("omega=50, centre=0.1,-0.2,tilt=30") == {"omega": "50", "centre": "0.1,-0.2", "tilt": "30"}
    assert parse_args({"omega": 1, "tilt": None}) == {"omega": 1} and parse_args(None) == {} and parse_args("") == {}
    with pytest.raises(SceneError, match="'fast' has no '='"):
        parse_args("fast,omega=5")


def test_only_scenes_with_a_model_are_dynamic():
    """Known without reading the model."""
    assert is_dynamic("falling_objects") and not is_dynamic("spinning_disk")


@pytest.mark.parametrize(
    ("more", "dark"),
    [
        ("", True),
        ("environment: 0.2\n", False),
        ("lights: {lamp: {kind: point, position: [0, 0, 2], intensity: 5}}\n", False),
        ("materials: {paint: {emission: 3}}\n", False),
    ],
)
@pytest.mark.parametrize("visuals", [True, False])
def test_a_scene_without_any_light_says_so(tmp_path, more, dark, visuals):
    path = tmp_path / "dark.yaml"
    head = "cameras: {cam0: {fov: 40 deg}}\nbodies: {b: {shapes: [{shape: box, size: [1, 1, 1], material: paint}]}}\n"
    path.write_text(head + (more if "paint" in more else f"materials: {{paint: {{albedo: 0.5}}}}\n{more}"))
    notes = load_scene(str(path), visuals=visuals).notes
    assert [note.startswith("nothing gives light") for note in notes] == ([True] if dark else [])


@pytest.mark.parametrize("name", ["c d", "a/b", "", "é*"])
def test_a_camera_whose_name_no_topic_can_have_is_refused(tmp_path, name):
    path = tmp_path / "named.yaml"
    path.write_text(f"cameras: {{'{name}': {{fov: 40 deg}}}}\n")
    with pytest.raises(SceneError, match=r"named\.yaml:1: .*take letters, digits, _ \. and -"):
        load_scene(str(path), visuals=False)


def test_the_documents_list_the_keys_that_the_reader_names():
    """The list in docs/scenes.md is that of the builder, word for word."""
    import textwrap
    from pathlib import Path

    from evis.scene.yaml import build

    assert build.__doc__ is not None
    listed = build.__doc__.split("over the arguments.\n\n")[1].split("Entries of bodies")[0].rstrip()
    document = Path(__file__).parents[2] / "docs" / "scenes.md"
    assert textwrap.dedent(listed) in document.read_text()


def test_the_page_says_which_arguments_vary_draws():
    """Of a scene of which it says that all are drawn, or all but some: those of the file whose default is drawn."""
    import re
    from pathlib import Path

    from evis.scene.load import drawn_places, scene_args

    page = (Path(__file__).parents[2] / "docs" / "scenes.md").read_text()
    told = re.findall(r"^## (\w+)\n(?:(?!^#).)*?`vary(?::=1)?` draws all ([^,.]*)", page, re.M | re.S)
    assert {name for name, _ in told} == {"spinning_disk", "tunnel_exit", "warehouse", "balls"}
    for name, how in told:
        own = {key for key, arg in scene_args(name).items() if arg.type is not str}
        drawn = {place.split(".")[1] for place in drawn_places(name, {"vary": 1.0}) if place.startswith("args.")}
        assert own - drawn - {"vary", "width", "height"} == set(re.findall(r"`(\w+)`", how)), name
