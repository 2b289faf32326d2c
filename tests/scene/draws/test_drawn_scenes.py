"""Values of a scene file that are drawn: what they become, what they depend on, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evis.config.params import ParamError
from evis.scene import SceneError, load_scene, scene_args
from evis.scene.load import scene_values
from evis.scene.model import Scene

SCENE = """\
args: {args}
cameras:
  cam0: {camera}
materials:
  paint: {material}
  other: {albedo: 0.2}
bodies:
  ball:
    {frame}
    motion: {motion}
    shapes: [{shape}]
lights:
  lamp: {light}
environment: {sky}
"""
PLAIN = {
    "args": "{}",
    "camera": "{position: [0, -1, 0], look_at: [0, 0, 0], fov: 40 deg}",
    "material": "{albedo: 0.5}",
    "frame": "position: [0, 0, 0]",
    "motion": "{kind: sinusoid, amplitude: [0.1, 0, 0], frequency: 1}",
    "shape": "{shape: sphere, radius: 0.1, material: paint}",
    "light": "{kind: point, position: [1, -2, 2], intensity: 10}",
    "sky": "0.2",
}


def written(folder: Path, **parts: str) -> str:
    text = SCENE
    for key, value in {**PLAIN, **parts}.items():
        text = text.replace(f"{{{key}}}", value)
    path = folder / "drawn.yaml"
    path.write_text(text)
    return str(path)


def values(scene: Scene) -> dict[str, Any]:
    return {one.place: one.value for one in scene.drawn}


def test_values_of_every_kind_are_drawn(tmp_path: Path) -> None:
    """Numbers, angles with their unit, vectors element by element, colours, choices, whole numbers, motion and sky."""
    name = written(
        tmp_path,
        camera="{position: [0, -1, {from: 0, to: 1}], look_at: [0, 0, 0], fov: {from: 30 deg, to: 0.7}}",
        material="{albedo: {choose: [0.1, [0.2, 0.3, 0.4]]}, "
        "texture: {kind: checker, size: 16, cells: {from: 2, to: 9}}}",
        frame="rotation: {axis: {normal: {mean: [0, 0, 0], sigma: 1}}, angle: {from: 0, to: 180 deg}}",
        motion="{kind: sinusoid, amplitude: {from: [0, 0, 0], to: [1, 0, 2]}, frequency: 1}",
        shape="{shape: sphere, radius: {normal: {mean: 0.1, sigma: 0.5, min: 0.05, max: 0.2}}, material: paint}",
        light="{kind: point, position: [1, -2, 2], intensity: {from: 1, to: 100, log: true}}",
        sky="{from: [0.1, 0.1, 0.1], to: [0.3, 0.3, 0.3]}",
    )
    for seed in range(5):
        scene = load_scene(name, seed=seed)
        drawn = values(scene)
        assert scene.environment == pytest.approx([drawn[f"environment[{i}]"] for i in range(3)])
        assert scene.lights[0].colour == pytest.approx(np.full(3, drawn["lights.lamp.intensity"]))
        camera = scene.cameras[0]
        fov = 2 * np.arctan(0.5 * camera.height / camera.k[1, 1])
        assert fov == pytest.approx(drawn["cameras.cam0.fov"]) and np.radians(30) <= fov <= 0.7
        pose = scene.bodies[scene.body_index("cam0")].trajectory.pose(np.zeros(1, np.int64))[0]
        assert pose[:3] == pytest.approx([0, -1, drawn["cameras.cam0.position[2]"]])
        assert 0.05 <= drawn["bodies.ball.shapes[0].radius"] <= 0.2
        assert np.ptp(scene.instances[0].mesh.vertices) == pytest.approx(
            2 * drawn["bodies.ball.shapes[0].radius"], rel=0.02
        )
        amplitude = scene.bodies[scene.body_index("ball")].trajectory.shifts[0].amplitude
        assert amplitude == pytest.approx(
            [drawn[f"bodies.ball.motion[0].amplitude[{i}]"] if i != 1 else 0 for i in range(3)]
        )
        assert drawn["materials.paint.texture.cells"] in range(2, 10)
        turned = scene.bodies[scene.body_index("ball")].trajectory.start[3:]
        half = 0.5 * np.radians(drawn["bodies.ball.rotation[0].angle"])
        assert abs(turned[3]) == pytest.approx(np.cos(half))


def test_a_draw_depends_on_seed_and_place_alone(tmp_path: Path) -> None:
    """One more draw, before or after it, shifts nothing; another seed changes everything."""
    light = "{kind: point, position: {from: [0, 0, 1], to: [1, 1, 2]}, intensity: 10}"
    alone = values(load_scene(written(tmp_path, light=light), seed=4))
    assert len(alone) == 3
    others = written(
        tmp_path, light=light, camera="{position: [0, -1, 0], fov: {from: 0.3, to: 0.4}}", sky="{choose: [0.1, 0.2]}"
    )
    more = values(load_scene(others, seed=4))
    assert len(more) == 5 and {place: more[place] for place in alone} == alone
    assert values(load_scene(others, seed=4)) == more
    assert all(
        a != b for a, b in zip(alone.values(), values(load_scene(others, seed=5)).values()) if isinstance(a, float)
    )


def test_a_new_entry_shifts_no_named_ones(tmp_path: Path) -> None:
    """Of a list, entries with a name are known by it."""
    text = "cameras: {cam0: {fov: 40 deg}}\nmaterials: {a: {albedo: 0.5}}\nenvironment: 1\nworld:\n"
    named = "  - {name: one, shape: sphere, radius: {from: 0.1, to: 0.2}, material: a}\n"
    found = []
    for first in ("", "  - {name: zero, shape: sphere, radius: {from: 0.1, to: 0.2}, material: a}\n"):
        path = tmp_path / "list.yaml"
        path.write_text(text + first + named)
        found.append(values(load_scene(str(path)))["world.one.radius"])
    assert found[0] == found[1]


def test_each_copy_draws_for_itself(tmp_path: Path) -> None:
    """By its name; `let` gives a value that several places of a copy share; the seed of `random` is drawn for all."""
    shape = (
        "{shape: box, size: ['${side}', '${side}', {from: 1, to: 2}], position: ['${k + shift}', 0, 0], "
        "material: paint, copies: {over: {k: 20}, let: {side: {from: 1, to: 2}}, "
        "random: {seed: {from: 0, to: 999}, shift: {from: 0, to: 1}}}}"
    )
    scene = load_scene(written(tmp_path, shape=shape), seed=2)
    sizes = np.array([np.ptp(i.mesh.vertices, axis=0) for i in scene.instances])
    assert len(sizes) == 20
    assert np.array_equal(sizes[:, 0], sizes[:, 1])
    assert len(np.unique(sizes[:, 0])) == len(np.unique(sizes[:, 2])) == 20
    shifts = [
        [i.pose[0] - k for k, i in enumerate(load_scene(written(tmp_path, shape=shape), seed=s).instances)]
        for s in (2, 3)
    ]
    assert np.all(np.abs(np.subtract(*shifts)) > 0) and np.ptp(shifts[0]) > 0.5


def test_arguments_are_drawn_unless_given(tmp_path: Path) -> None:
    """A drawn default is a value that several places share; it may depend on arguments before it."""
    args = (
        "{vary: {default: 1, min: 0, max: 1, help: how much}, "
        "rate: {default: {from: '${5 - vary}', to: '${5 + vary}'}, min: 0, max: 6, unit: Hz, help: of the ball}, "
        "side: {type: vector, default: {from: [0, 0], to: [1, 1]}, help: of it}, "
        "n: {type: int, default: {from: 1, to: 3}, help: of it}}"
    )
    motion = "{kind: sinusoid, amplitude: [0.1, 0, 0], frequency: '${rate}'}"
    name = written(tmp_path, args=args, motion=motion, sky="'${rate}'")
    scenes = [load_scene(name, seed=seed) for seed in range(20)]
    rates = [scene.bodies[0].trajectory.shifts[0].frequency for scene in scenes]
    assert np.array_equal(np.float32(rates), [scene.environment[0] for scene in scenes])
    assert min(rates) >= 4 and max(rates) <= 6 and len(set(rates)) == 20
    assert load_scene(name, {"rate": 2}).bodies[0].trajectory.shifts[0].frequency == 2
    given = load_scene(name, {"vary": "0"}, seed=3)
    assert given.bodies[0].trajectory.shifts[0].frequency == 5
    assert not any("rate" in one.place for one in given.drawn)
    assert scene_args(name)["rate"].default is None and "4 to 6" in scene_args(name)["rate"].help
    assert scene_values(name, {})["rate"] is None and scene_values(name, {"vary": 0})["rate"] == 5
    assert len({values(scene)["args.n.default"] for scene in scenes}) == 3


def test_an_argument_drawn_out_of_its_range_is_refused(tmp_path: Path) -> None:
    name = written(tmp_path, args="{rate: {default: {from: 5, to: 9}, max: 4, help: of the ball}}")
    with pytest.raises(ParamError, match=r"drawn\.yaml:1: rate is .*, the most is 4"):
        load_scene(name)


@pytest.mark.parametrize(
    ("part", "text", "line", "said"),
    [
        ("sky", "{from: 3, to: 1}", 14, "from is 3, more than `to`, which is 1"),
        ("sky", "{choose: []}", 14, "choose must be a list of at least one value"),
        ("sky", "{choose: 3}", 14, "choose must be a list of at least one value"),
        ("sky", "{choose: [{kind: sky}, 1]}", 14, "choose has a map in it"),
        ("sky", "{from: 0, too: 1}", 14, "needs 'to'"),
        ("sky", "{from: 0, to: 1, lgo: true}", 14, "lgo is not known here; did you mean 'log'"),
        ("sky", "{from: 0, to: 1, log: true}", 14, "with `log` it must be more than 0"),
        ("sky", "{to: 1}", 14, "to stands without from"),
        ("sky", "{from: 0, to: 1, choose: [1]}", 14, "are given; leave one out"),
        ("sky", "{from: red, to: 1}", 14, "it must be a finite number"),
        ("sky", "{from: [0, 0], to: [1, 1, 1]}", 14, "must be a list of 2 as from is"),
        ("sky", "{normal: {mean: 1}}", 14, "needs 'sigma'"),
        ("sky", "{normal: {mean: 1, sigma: -1}}", 14, "the least is 0"),
        ("sky", "{normal: {mean: 1, sigma: 1, min: 2, max: 1}}", 14, "leaves nothing between"),
        ("sky", "{normal: 3}", 14, "must be a map"),
        ("material", "{albedo: {from: 0.5, to: 1.5}}", 5, "the most is 1"),
        ("material", "{texture: {choose: [a, b]}}", 5, "texture is drawn as a whole"),
        ("material", "{albedo: {choices: [0.1, 0.2]}}", 5, "a draw is {from: a, to: b}, {choose:"),
        ("motion", "{kind: spin, axis: {choices: [x, y]}, rate: 1}", 10, "a draw is {from: a, to: b}, {choose:"),
        ("shape", "{shape: sphere, radius: 1, material: {choices: [a]}}", 11, "a draw is {from: a, to: b}, {choose:"),
        ("motion", "{choose: [spin, swing]}", 10, "motion is drawn as a whole"),
        ("light", "{from: 1, to: 2}", 13, "lamp is drawn as a whole"),
        ("shape", "{shape: sphere, copies: {over: {k: 3}, random: {a: 3}}}", 11, "must be a draw"),
        ("material", "{texture: {kind: checker, cells: {from: 2.2, to: 2.8}}}", 5, "no whole number between"),
        ("material", "{texture: {kind: checker, cells: {normal: {mean: 2, sigma: 1}}}}", 5, "gives no whole numbers"),
        ("args", "{a: {default: 1, min: {from: 0, to: 1}, help: x}}", 1, "must be the same in every world"),
    ],
)  # fmt: skip
def test_a_wrong_draw_is_told_with_its_line(part: str, text: str, line: int, said: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError) as caught:
        for seed in range(30):
            load_scene(written(tmp_path, **{part: text}), seed=seed)
    assert f"drawn.yaml:{line}: " in str(caught.value) and said in str(caught.value)
