"""An environment that is reset with a seed gets that seed's world, and gives what a run of its own gives in it."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import evis
from evis.simulation.step import Step

SMALL: dict[str, Any] = {"device": "cpu", "width": 40, "height": 30, "upsampling": 4, "audit": 0, "outputs": ["events"]}
COLUMNS = ("t", "x", "y", "p")
SEED, ENVS, RESET = 5, 3, 77


def made(scene: str, **more: Any) -> evis.Simulation:
    """A small simulation, of whose warnings there is nothing to say here."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return evis.Simulation(scene, **{**SMALL, **more})


def events(steps: Sequence[Step], env: int, origin_ns: int = 0) -> dict[str, bytes]:
    """The events of an environment in all steps, in time since the origin."""
    found = {}
    for name in COLUMNS:
        parts = []
        for step in steps:
            first, end = step.events.env_offsets[env : env + 2]
            parts.append(np.asarray(getattr(step.events, name))[first:end])
        column = np.concatenate(parts)
        found[name] = (column - origin_ns if name == "t" else column).tobytes()
    return found


def single(scene: str, seed: int, steps: int, **more: Any) -> dict[str, bytes]:
    """The events of a run by itself."""
    with made(scene, seed=seed, **more) as sim:
        return events([sim.reset(), *(sim.step() for _ in range(steps))], 0)


def check(scene: str, before: int = 2, after: int = 3, envs: int = ENVS, which: int = -1, **more: Any) -> None:
    """Every environment is a run by itself, the one that is reset alone from its reset on."""
    which = range(envs)[which]
    if more.get("interpolator") == "none":  # each frame is a keyframe
        before, after = (4 * count for count in (before, after))
    with made(scene, seed=SEED, envs=envs, **more) as sim:
        first = [sim.reset(), *(sim.step() for _ in range(before))]
        begin = sim.reset(seed=[RESET], envs=[which])
        then = [sim.step() for _ in range(after)]
    anew = events([begin, *then], which, begin.stamp_ns)
    assert anew == single(scene, RESET, after, **more) and len(anew["x"]) > 50
    assert events(first, which) == single(scene, SEED + which, before, **more)
    assert not events([begin], 0)["t"]
    for env in {0, which - 1}:
        own = events([*first, *then], env)
        assert own == single(scene, SEED + env, before + after, **more)
        assert own != anew


@pytest.mark.parametrize(
    ("scene", "more"),
    [
        ("spinning_disk", {"preset": "davis346"}),
        ("robot_arm", {"interpolator": "splat"}),
        ("pong", {"interpolator": "none"}),
        ("falling_objects", {"vary": 0, "preset": "davis346"}),
    ],
)
def test_reset_alone_into_another_world(scene: str, more: dict[str, Any]) -> None:
    """Byte for byte; its neighbours go on."""
    check(scene, **{"vary": 1, **more})


@pytest.mark.slow
@pytest.mark.parametrize("interpolator", ["rigid", "splat", "none"])
@pytest.mark.parametrize("scene", ["spinning_disk", "falling_objects", "robot_arm", "drone", "fidget_spinner", "pong"])
def test_everywhere(scene: str, interpolator: str) -> None:
    check(scene, vary=1, interpolator=interpolator, preset="davis346")


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["spinning_disk", "robot_arm"])
def test_environment_three_of_sixteen(scene: str) -> None:
    check(scene, envs=16, which=3, vary=1, preset="davis346")


def test_a_reset_of_all_is_a_new_run_whatever_was_before() -> None:
    """With the worlds that the constructor's seed draws, or another's, or those of a seed for each."""
    more: dict[str, Any] = {"vary": 1, "preset": "davis346"}
    truth = [single("spinning_disk", seed, 2, **more) for seed in (SEED, SEED + 1, RESET, 9)]
    with made("spinning_disk", seed=SEED, envs=2, **more) as sim:
        sim.reset()
        sim.reset(seed=[RESET], envs=[1])
        sim.step()
        for first, seed in ((0, None), (2, [RESET, 9]), (0, SEED)):
            steps = [sim.reset(seed=seed), sim.step(), sim.step()]
            assert [events(steps, env) for env in (0, 1)] == truth[first : first + 2]


LOOKS = """
cameras: {cam0: {position: [0, -1.2, 0.3], look_at: [0, 0, 0], fov: {from: 38 deg, to: 50 deg}}}
bodies:
  block:
    motion:
      - {kind: sinusoid, amplitude: [{from: 0.1, to: 0.3}, 0, 0], frequency: {from: 3, to: 6}}
      - {kind: spin, axis: {normal: {mean: [0, 0, 0], sigma: 1}}, rate: {from: 2, to: 9}}
    shapes: [{shape: box, size: {from: [0.1, 0.1, 0.1], to: [0.2, 0.2, 0.2]}, material: paint}]
materials:
  paint: {texture: {kind: checker, size: 32, cells: {from: 2, to: 8}, low: 0.1, high: 0.9}}
  grey: {albedo: {from: 0.2, to: 0.9}}
world: [{shape: plane, size: [3, 3], position: [0, 0.6, 0], rotation: {axis: [1, 0, 0], angle: 90 deg}, material: grey}]
lights: {lamp: {kind: point, position: [0.5, -1, 1], intensity: {from: 3, to: 10, log: true}}}
environment: 0.2
"""
"""A scene in which the camera's lens, a mesh, its motion, materials and light are drawn."""
LABELS = "flow,segmentation,boxes,boxes3d,forward_flow,backward_flow,events"


def labels(step: Step, env: int) -> dict[str, bytes]:
    """What labels say of an environment, but for where its events lie in the packet."""
    message = step.labels
    found = {}
    for name, array in message.arrays().items():
        table = next((t for t in ("box3d", "box", "event") if name.startswith(f"{t}_")), "")
        if name == "flow_t":
            continue
        if not table:
            found[name] = np.asarray(array[env]).tobytes()
        elif not name.endswith("_env"):
            rows = message.arrays().get(f"{table}_env")
            found[name] = np.asarray(array)[rows == env].tobytes() if rows is not None else b""
        if name == "box":
            found[name] = np.asarray(array)[message.box_env == env].tobytes()
    return found


def test_labels_are_of_the_new_world(tmp_path: Path) -> None:
    """Of every environment those of a run by itself: flow by its lens, ids and boxes by its meshes."""
    scene = tmp_path / "drawn.yaml"
    scene.write_text(LOOKS)
    more: dict[str, Any] = {"labels": LABELS, "outputs": ["events", "labels"], "threshold": 0.1}
    with made(str(scene), seed=SEED, envs=ENVS, **more) as sim:
        batch = [sim.reset(), sim.step(), sim.step(), sim.reset(seed=[RESET], envs=[1]), sim.step(), sim.step()]
    for env, seed, first in ((0, SEED, 0), (2, SEED + 2, 0), (1, RESET, 3)):
        with made(str(scene), seed=seed, **more) as sim:
            truth = [sim.reset(), *(sim.step() for _ in range(4 if not first else 2))]
        mine = [step for k, step in enumerate(batch) if k >= first and (first or k != 3)]
        assert len(mine) == len(truth)
        for own, other in zip(mine, truth):
            assert labels(own, env) == labels(other, 0)
        assert sum(len(step.labels.event_instance) for step in truth) > 50
