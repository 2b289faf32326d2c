"""`copies:` and `include:` of scene files."""

import numpy as np
import pytest

from evis.scene import SceneError, load_scene

HEAD = "cameras: {cam0: {fov: 1}}\nmaterials: {m: {}, n: {albedo: 0.9}}\n"
SHAPE = "shape: sphere, radius: 0.1, material: m"


@pytest.fixture
def load(tmp_path):
    def load(text, **files):
        (tmp_path / "s.yaml").write_text(text)
        for name, content in files.items():
            (tmp_path / f"{name}.yaml").write_text(content)
        return load_scene(str(tmp_path / "s.yaml"))

    return load


def test_every_combination_with_its_own_values(load):
    """A count, a list, a derived value and a condition; names say which copy it is, the last variable is fastest."""
    scene = load(
        HEAD + "world:\n  - {name: ball, " + SHAPE + ', position: ["${x}", "${y}", 0],\n'
        '     copies: {over: {i: 3, y: [-1, 1]}, let: {x: "${i * 2.5}"}, if: "${not (i == 1 and y < 0)}"}}\n'
    )
    assert [i.name for i in scene.instances] == ["ball_0_0", "ball_0_1", "ball_1_1", "ball_2_0", "ball_2_1"]
    wanted = [[0, -1, 0], [0, 1, 0], [2.5, 1, 0], [5, -1, 0], [5, 1, 0]]
    assert np.array_equal([i.pose[:3] for i in scene.instances], wanted)
    assert len({id(i.mesh) for i in scene.instances}) == 1, "the same shape is made once"


def test_bodies_lights_cameras_and_what_is_in_them(load):
    """Variables reach the shapes, and a copy of the shapes within; other entries find a copy by its name."""
    scene = load(
        'cameras:\n  eye: {fov: 1, position: [0, "${k}", 0], copies: {over: {k: 2}}}\n'
        "materials: {m: {}}\n"
        "bodies:\n"
        '  shelf:\n    copies: {over: {k: 3}}\n    position: ["${k}", 0, 0]\n'
        "    shapes: [{" + SHAPE + ', position: [0, 0, "${10 * k + j}"], copies: {over: {j: 2}}}]\n'
        '  lamp: {copies: {over: {k: 3}}, parent: "shelf_${k}", position: [0, 0, 1]}\n'
        'lights: {l: {kind: point, intensity: "${1 + k}", position: [0, 0, 0], body: "lamp_${k}", '
        "copies: {over: {k: 3}}}}\n"
    )
    names = [b.name for b in scene.bodies]
    assert names == ["shelf_0", "shelf_1", "shelf_2", "lamp_0", "lamp_1", "lamp_2", "eye_0", "eye_1"]
    assert [i.name for i in scene.instances[:3]] == ["shelf_0_0", "shelf_0_1", "shelf_1_0"]
    assert [i.pose[2] for i in scene.instances] == [0, 1, 10, 11, 20, 21]
    pose = scene.bodies[5].trajectory.pose(np.zeros(1, np.int64))[0]
    assert pose[:3].tolist() == [2, 0, 1]
    assert [(x.name, x.body, x.colour[0]) for x in scene.lights] == [("l_0", 3, 1), ("l_1", 4, 2), ("l_2", 5, 3)]


def test_random_values_belong_to_their_copy(load):
    """Within their range, of their choice, the same every time, and not moved by a condition or another name."""
    ball = 'name: ball, shape: sphere, radius: "${r}", material: "${c}"'
    text = HEAD + "world:\n  - {" + ball + ", copies: {over: {i: 400}, %s}}\n"
    draw = "random: {seed: 5, r: {from: 1, to: 3}, c: {choose: [m, n]}%s}"

    def radii(scene):
        return {i.name: float(i.mesh.vertices[:, 2].max()) for i in scene.instances}

    all_of_them = load(text % (draw % ""))
    size = np.array(list(radii(all_of_them).values()))
    assert 1 <= size.min() < 1.05 and 2.95 < size.max() <= 3
    assert abs(size.mean() - 2) < 4 * 2 / np.sqrt(12 * 400)  # four standard errors of a uniform mean
    assert 140 < sum(i.material for i in all_of_them.instances) < 260
    some = radii(load(text % (draw % ", other: {from: 0, to: 1}" + ', if: "${i % 2 == 0}"')))
    assert len(some) == 200 and some.items() <= radii(all_of_them).items()


@pytest.mark.parametrize(
    "copies, words",
    [
        ("{}", "needs 'over'"),
        ("{over: {i: 1000, j: 1000}}", "makes 1000000 copies; the most is 100000"),
        (f"{{over: {{{', '.join(f'v{i}: 100000' for i in range(70))}}}}}", "makes 10+ "),
        ("{over: {i: -1}}", "must be a whole number"),
        ("{over: {width: 2}}", "is the name of an argument already"),
        ("{over: {a b: 2}}", "is no name for a variable"),
        ("{over: {i: 2}, random: {r: {from: 0}}}", "needs 'to'"),
        ("{over: {i: 2}, random: {r: {choose: []}}}", "choose must be a list"),
        ("{over: {i: 2}, if: 3}", "if is 3; it must be true or false"),
        ("{over: {i: 2}, iff: 3}", "iff is not known here; did you mean 'if'"),
        ('{over: {i: 2}, let: {x: "${k}"}}', "x uses 'k'"),
    ],
)
def test_mistakes(load, copies, words):
    """One line with file and line."""
    with pytest.raises(SceneError, match=words) as caught:
        load(HEAD + "world:\n  - {name: ball, " + SHAPE + f", copies: {copies}}}\n")
    assert "s.yaml:4" in str(caught.value) and "\n" not in str(caught.value)


def test_include(load):
    """Lists and maps are put together, what the scene says itself counts; errors name the file they are in."""
    part = "materials: {m: {albedo: 0.1}, w: {}}\nworld: [{name: wall, shape: disk, radius: 1, material: w}]\n"
    part += "environment: 3\n"
    scene = load(HEAD + "include: part.yaml\nworld: [{name: ball, " + SHAPE + "}]\n", part=part)
    assert [i.name for i in scene.instances] == ["wall", "ball"] and np.allclose(scene.environment, 3)
    assert {m.name: float(m.albedo[0]) for m in scene.materials}["m"] == 0.5
    with pytest.raises(SceneError, match=r"part\.yaml:2: shape 1: radius is -1"):
        load(HEAD + "include: part.yaml\n", part=part.replace("radius: 1", "radius: -1"))
    with pytest.raises(SceneError, match=r"part\.yaml:1: an included scene file has no 'cameras'"):
        load(HEAD + "include: part.yaml\n", part="cameras: {}\n")
    with pytest.raises(SceneError, match=r"s\.yaml:3: include names nowhere\.yaml, which is not in"):
        load(HEAD + "include: nowhere.yaml\n")
    with pytest.raises(SceneError, match="world is not the same kind of thing"):
        load(HEAD + "include: part.yaml\nworld: {}\n", part=part)
