"""Parallel environments whose worlds differ: each is a run by itself with its seed, byte for byte."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from drawn_graph import MOVES, SENSOR, Graph, looks

from evis.bag.environments import join, split
from evis.scene.digest import appearance, motion
from evis.scene.parameters import worlds_of
from nodes.event_sensor.scene_parameters import resolve_with_scene
from nodes.interpolator.interpolator import Interpolator
from nodes.physics.engines.prescribed import PrescribedEngine
from nodes.renderer.renderer import Renderer

SEED, ENVS = 5, 3

MODEL = """
<mujoco><option timestep="0.001"/><worldbody>
  <geom name="floor" type="plane" size="1 1 0.1" rgba="0.5 0.5 0.5 1"/>
  <body name="box" pos="0 0 0.15"><freejoint/><geom type="box" size="0.05 0.08 0.1" rgba="0.8 0.3 0.2 1"/></body>
</worldbody></mujoco>
"""
DYNAMIC = """
mjcf: box.xml
cameras: {cam0: {position: [0, -0.6, 0.2], look_at: [0, 0, 0.1], fov: 50 deg}}
lights: {lamp: {kind: point, position: [0.5, -1, 1], intensity: {from: 2, to: 4}}}
model:
  bodies: {box: {mass_scale: {from: 0.5, to: 2}, friction: {from: 0.1, to: 1},
                 shift: {from: [0, 0, 0], to: [0.1, 0, 0.1]}, turn: {axis: [0, 1, 0], angle: {from: 0.2, to: 1.4}}}}
  materials: {"*": {albedo: {from: 0.3, to: 0.8}}}
"""


def written(folder: Path, text: str) -> Path:
    (folder / "box.xml").write_text(MODEL)
    path = folder / "drawn.yaml"
    path.write_text(text)
    return path


def check(scene: Path, method: str, **more: object) -> Graph:
    together = Graph(scene, SEED, ENVS, method, **more)
    events = []
    for env in range(ENVS):
        alone = Graph(scene, SEED + env, 1, method, **more)
        assert together.of(env, ENVS) == alone.of(0, 1)
        events.append(sum(len(m.t) for m in alone.messages["events"]))
        # Of bodies that rest in one environment and move in another, the states are the same however they are told.
        for mine, own in zip(together.messages["state"], alone.messages["state"]):
            for a, b in zip(mine.rows(), own.rows()):
                assert np.array_equal(a[env], b[0])
    assert min(events) > 0 and len(set(events)) == ENVS
    return together


@pytest.mark.parametrize("method", ["rigid", "none"])
def test_worlds_that_look_and_move_differently(method: str, tmp_path: Path) -> None:
    """Everything is drawn: camera, shape, material, texture, light, sky, start and motion."""
    graph = check(written(tmp_path, looks()), method)
    drawn = graph.messages["info"][0].drawn
    assert {"cameras.cam0.fov", "lights.lamp.intensity", "bodies.ball.shapes[0].size[2]"} < drawn.keys()
    assert all(len(values) == ENVS for values in drawn.values())


@pytest.mark.parametrize("more", ["", "readout_rate: 1.0e5, ", "model: v2e, "])
def test_sensors_that_differ(more: str, tmp_path: Path) -> None:
    """Threshold and faults are drawn, with a readout too, and of another event model."""
    text = MOVES + SENSOR.replace("{threshold:", "{" + more + "threshold:")
    if "v2e" in more:
        text = text.replace("leak_rate: {from: 1, to: 20}, ", "")
    graph = check(written(tmp_path, text), "rigid")
    assert len(graph.messages["info"][0].drawn["sensor.threshold"]) == ENVS


def test_a_wrong_parameter_of_the_sensor_is_told(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="did you mean 'threshold'"):
        Graph(written(tmp_path, MOVES + "sensor: {treshold: 0.2}\n"), 1, 1, keyframes=1)
    with pytest.raises(ValueError, match="environments side by side need the same"):
        Graph(written(tmp_path, MOVES + "sensor: {crossing: {choose: [linear, cubic]}}\n"), 1, 9, keyframes=1)


def test_what_is_given_counts_more_than_the_scene(tmp_path: Path) -> None:
    text = MOVES + "sensor: {threshold: 0.3, leak_rate: 5}\n"
    params = {"scene": str(written(tmp_path, text)), "preset": "ideal", "threshold": 0.1}
    found = resolve_with_scene("test", params)
    assert (found["threshold"], found["leak_rate"]) == (0.1, 5)
    assert resolve_with_scene("test", {**params, "scene": "not/here.yaml"})["leak_rate"] == 0


def test_worlds_that_move_differently_are_drawn_by_one_renderer(tmp_path: Path) -> None:
    graph = check(written(tmp_path, MOVES), "rigid")
    assert isinstance(graph.renderer.renderer, Renderer)
    assert isinstance(graph.interpolator.interpolator, Interpolator)


def test_worlds_of_one_look_are_drawn_by_one_renderer_wherever_they_stand(tmp_path: Path) -> None:
    """Of three environments the first and the last look the same."""
    scene = written(tmp_path, MOVES.replace("albedo: 0.4", "albedo: {choose: [0.2, 0.6]}"))
    grey = [_albedo(scene, s) for s in range(40)]
    seed = next(s for s in range(38) if grey[s] == grey[s + 2] != grey[s + 1])
    together = Graph(scene, seed, 3)
    assert _looks(together) == [[0, 2], [1]]
    for env in range(3):
        assert together.of(env, 3) == Graph(scene, seed + env, 1).of(0, 1)


def _looks(graph: Graph) -> list[list[int]]:
    """Environments that one renderer draws."""
    return [envs.tolist() for _, envs in graph.renderer.worlds.groups(appearance)]


def _albedo(scene: Path, seed: int) -> float:
    world = worlds_of("test", {"scene": str(scene), "seed": seed, "envs": 1}).scenes[0]
    return round(float(world.materials[1].albedo[0]), 3)


def test_models_whose_masses_and_starts_differ(tmp_path: Path) -> None:
    graph = check(written(tmp_path, DYNAMIC), "rigid")
    assert graph.messages["state"][-1].qpos.shape == (ENVS, len(graph.messages["state"][-1].t), 7)


def test_splat_needs_no_worlds(tmp_path: Path) -> None:
    check(written(tmp_path, looks()), "splat")


def test_without_draws_all_environments_share_a_world(tmp_path: Path) -> None:
    """Today's batch: one engine, one renderer, one interpolator, one Scene."""
    text = MOVES.replace("{from: 0, to: 0.1}", "0.05").replace("{normal: {mean: [0, 0, 0], sigma: 1}}", "[0, 0, 1]")
    text = text.replace("{from: 3, to: 6}", "4").replace("{from: 2, to: 9}", "5")
    graph = Graph(written(tmp_path, text), 5, 3, keyframes=2, scene_args="vary=0")
    assert isinstance(graph.physics.engine, PrescribedEngine)
    assert isinstance(graph.renderer.renderer, Renderer)
    assert graph.messages["info"][0].drawn == {} and graph.physics.worlds.alike
    assert graph.of(0, 3) == graph.of(2, 3)


def test_equal_draws_are_loaded_once(tmp_path: Path) -> None:
    """Worlds are shared by environments that draw the same, and by nodes; another seed changes one alone."""
    path = written(tmp_path, MOVES.replace("vary: {default: 1,", "vary: {type: int, default: {choose: [0, 1]},"))
    path.write_text("cameras: {cam0: {fov: 40 deg}}\nenvironment: {choose: [0.1, 0.2]}\n")
    params = {"scene": str(path), "seed": 0, "envs": 40}
    worlds = worlds_of("test", params)
    assert len({id(scene) for scene in worlds.scenes}) == 2
    assert {id(scene) for scene in worlds_of("other", params).scenes} == {id(scene) for scene in worlds.scenes}
    other = next(s for s in range(40) if worlds.scenes[s] is not worlds.scenes[0])
    fresh = worlds.with_seeds([3], [other])
    assert fresh.scenes[3] is worlds.scenes[other] and fresh.seeds == [0, 1, 2, other, *range(4, 40)]
    path.write_text("cameras: {cam0: {fov: 50 deg}}\nenvironment: 0.3\n")
    assert worlds_of("test", params).alike, "the file has changed"


def test_keys_tell_looks_from_motion(tmp_path: Path) -> None:
    path = written(tmp_path, MOVES)
    a, b = worlds_of("test", {"scene": str(path), "seed": 1, "envs": 2}).scenes
    assert appearance(a) == appearance(b) and motion(a) != motion(b)
    path = written(tmp_path, looks())
    a, b = worlds_of("test", {"scene": str(path), "seed": 1, "envs": 2}).scenes
    assert appearance(a) != appearance(b)


def test_worlds_with_other_things_do_not_go_together(tmp_path: Path) -> None:
    text = MOVES.replace("world: [{", "world: [{copies: {over: {k: {from: 1, to: 4}}}, name: wall, ")
    with pytest.raises(
        ValueError,
        match=r"instances of environment \d, of seed \d, are not those of environment 0: it (lacks|has) 'wall",
    ):
        worlds_of("test", {"scene": str(written(tmp_path, text)), "seed": 1, "envs": 8})


def test_info_of_differing_cameras_is_split_and_joined(tmp_path: Path) -> None:
    """In a bag each environment has its own camera and its own draws."""
    info = Graph(written(tmp_path, looks()), SEED, ENVS, keyframes=1).messages["info"][0]
    parts = split(info, ENVS)
    for env, (part, _) in enumerate(parts):
        alone = Graph(tmp_path / "drawn.yaml", SEED + env, 1, keyframes=1).messages["info"][0]
        assert np.array_equal(part.k, alone.k) and part.drawn == alone.drawn
    joined = join(parts)
    assert joined.drawn == info.drawn and np.array_equal(joined.env_k, info.env_k) and np.array_equal(joined.k, info.k)
