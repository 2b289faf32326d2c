"""MuJoCo Warp in the place of MuJoCo: the same world to float32, each environment by itself, and what it refuses."""

from pathlib import Path

import numpy as np
import pytest
from environments_rig import controls, engine_of, told

from evis.scene import load_scene
from nodes.physics.dynamics.batch.mujoco_threads import MujocoThreads
from nodes.physics.dynamics.batch.unsupported import Unsupported
from nodes.physics.engines.mujoco_engine import MujocoEngine
from nodes.physics.engines.separate import SeparateEngines
from nodes.physics.environments.environments import Environments
from nodes.physics.node import PhysicsNode
from nodes.physics.precision.stepping import Stepping
from nodes.physics.precision.tolerance import Tolerance

GAP_NS = 33_333_333


def devices() -> list:
    return [pytest.param("cpu", marks=pytest.mark.extras), pytest.param("cuda", marks=pytest.mark.gpu)]


@pytest.fixture(params=devices())
def device(request: pytest.FixtureRequest) -> str:
    pytest.importorskip("mujoco_warp")
    return request.param


def test_it_is_the_same_world(tmp_path: Path, device: str) -> None:
    """A puck that falls on the ground and a driven cart, 0.4 s under actions: positions, joints and contacts."""
    one, other = engine_of(tmp_path, 3), engine_of(tmp_path, 3, warp=device)
    for n in range(1, 13):
        action = controls(n, 3)
        expected, found = one.advance(n * GAP_NS, action), other.advance(n * GAP_NS, action)
        # float32 at a metre, and a contact of 14 ms
        np.testing.assert_allclose(found.pose, expected.pose, atol=2e-5)
        np.testing.assert_allclose(found.twist, expected.twist, atol=2e-3)
        np.testing.assert_allclose(found.qpos, expected.qpos, atol=2e-5)
        assert np.array_equal(found.t, expected.t) and np.array_equal(found.contacts.env, expected.contacts.env)
        np.testing.assert_allclose(found.contacts.force, expected.contacts.force, atol=0.02 * 9.81, rtol=0.02)
        assert found.faults == expected.faults == []
    assert len(found.contacts.env) >= 3 and not other.checked


def test_what_goes_wrong_in_one_is_told_as_mujoco_tells_it(tmp_path: Path, device: str) -> None:
    """A velocity that is not finite: that environment begins anew with the same words, the others go on."""
    one, other = engine_of(tmp_path, 3), engine_of(tmp_path, 3, warp=device)
    for n in range(1, 7):
        if n == 3:
            for engine in (one, other):
                engine.data[1].qvel[6] = np.nan
        expected, found = one.advance(n * GAP_NS), other.advance(n * GAP_NS)
        assert found.faults == expected.faults and found.warnings == expected.warnings
        np.testing.assert_allclose(found.pose, expected.pose, atol=2e-5)
        assert (n == 3) == bool(found.faults) == bool(found.again)
    assert other.checked == 1


def test_single_ones_are_reset(tmp_path: Path, device: str) -> None:
    """Environments in times of their own go on side by side: each as the same one by MuJoCo."""
    worlds = [Environments(engine_of(tmp_path, 4, warp=warp), 4, 30.0) for warp in (None, device)]
    for each in worlds:
        each.advance(0)
    for k in range(1, 16):
        if k in (3, 5, 6, 11):
            for each in worlds:
                each.restart([k % 4], [-1 if k % 2 else 17], [1], k - 1)
                each.present()
        expected, found = (each.advance(k, controls(k, 4)) for each in worlds)
        np.testing.assert_allclose(found.pose, expected.pose, atol=5e-5)
        assert np.array_equal(found.t, expected.t)


def test_a_run_is_repeated_to_the_bit(tmp_path: Path, device: str) -> None:
    """On the same device, also where other environments move otherwise."""
    runs = []
    for _ in range(2):
        engine = engine_of(tmp_path, 3, warp=device)
        runs.append([told(engine.advance(n * GAP_NS, controls(n, 3)), k) for n in range(1, 9) for k in range(3)])
    assert runs[0] == runs[1]


def test_what_it_cannot_take_is_said(tmp_path: Path) -> None:
    """In one line, and MuJoCo itself moves the scene."""
    with pytest.raises(Unsupported, match="physics_tolerance"):
        MujocoEngine(
            load_scene("falling_objects", visuals=False),
            0,
            2,
            warp="cpu",
            stepping=Stepping(tolerance=Tolerance(1e-3, 1e-3)),
        )
    node = PhysicsNode(
        "physics", {"scene": "cart_pole", "engine": "mujoco_warp", "physics_tolerance": [1e-3], "duration": 0.1}
    )
    said: list[str] = []
    node.warn = said.append  # type: ignore[method-assign]
    node.setup()
    assert isinstance(node.engine, MujocoEngine)
    assert any("MuJoCo Warp cannot take scene cart_pole" in text and "\n" not in text for text in said)


def test_worlds_that_cannot_be_stepped_are_moved_by_mujoco(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where a device has too little memory for what a step needs."""
    from nodes.physics.dynamics.batch.warp_worlds import WarpWorlds

    def too_large(self: WarpWorlds) -> None:
        raise RuntimeError("Failed to allocate\n2764995071 bytes")

    monkeypatch.setattr(WarpWorlds, "_step_worlds", too_large)
    node = PhysicsNode("physics", {"scene": "cart_pole", "engine": "mujoco_warp", "envs": 3, "device": device})
    said: list[str] = []
    node.warn = said.append  # type: ignore[method-assign]
    node.setup()
    (text,) = [text for text in said if "MuJoCo Warp" in text]
    assert "3 of its worlds cannot be stepped: Failed to allocate 2764995071 bytes; MuJoCo itself moves it" in text
    assert isinstance(node.engine._batch, MujocoThreads)


def test_many_degrees_of_freedom_are_dense(device: str) -> None:
    """From 33 on MuJoCo Warp would take sparse matrices, whose deterministic sums need GB for a thousand worlds."""
    from nodes.physics.dynamics.batch.warp_worlds import WarpWorlds

    engine = MujocoEngine(load_scene("falling_objects", visuals=False), 0, 2)
    assert engine.model.nv > 32
    assert not WarpWorlds(engine.model, 2, device)._model.is_sparse


def test_it_is_said_once_for_environments_with_worlds_of_their_own() -> None:
    params = {"scene": "cart_pole", "scene_args": "vary=1", "envs": 3, "physics_tolerance": [1e-3], "duration": 0.1}
    node = PhysicsNode("physics", {**params, "engine": "mujoco_warp"})
    said: list[str] = []
    node.warn = said.append  # type: ignore[method-assign]
    node.setup()
    assert isinstance(node.engine, SeparateEngines)
    assert sum("MuJoCo Warp cannot take scene cart_pole" in text for text in said) == 1


def test_it_is_never_chosen_by_itself() -> None:
    """On a GPU with many environments neither."""
    node = PhysicsNode("physics", {"scene": "cart_pole", "device": "cuda", "envs": 256, "duration": 0.1})
    said: list[str] = []
    node.warn = said.append  # type: ignore[method-assign]
    node.setup()
    assert isinstance(node.engine._batch, MujocoThreads) and not said
