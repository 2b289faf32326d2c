"""Steps taken at once leave what steps taken one by one leave, to the bit, also where something goes wrong."""

from collections.abc import Iterator

import mujoco
import numpy as np
import pytest

from evis.scene import load_scene
from nodes.physics.engines.mujoco_engine import MujocoEngine
from nodes.physics.interval import Extras

FALL = """<mujoco><option timestep="0.001" gravity="0 0 -18000"/><worldbody>
<body name="rock" pos="0 0 0.3"><freejoint/><geom size=".1" mass="1"/></body></worldbody></mujoco>"""


def course(engine: MujocoEngine, stamps: list[int]) -> Iterator[tuple]:
    """What the engine gives at each stamp, as bytes and texts, under controls that change."""
    for n, stamp in enumerate(stamps):
        found = engine.advance(stamp, np.full((engine.envs, engine.actuators.count), 0.3 * np.sin(n)))
        arrays = (found.t, found.end_pose, found.moving_pose, found.moving_twist, found.qpos, found.qvel)
        assert found.contacts is not None
        contacts = tuple(np.asarray(a).tobytes() for a in vars(found.contacts).values())
        yield tuple(a.tobytes() for a in arrays), contacts, found.faults, found.warnings


@pytest.mark.parametrize("scene", ["cart_pole", "pong", "robot_arm", "falling_objects"])
@pytest.mark.parametrize("gap_ns", [33_333_333, 20_000_000, 400_000])
def test_it_is_the_same_course(scene: str, gap_ns: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stamps on the grid, beside it, and closer together than its steps; one environment by itself, and two together.
    Steps with checks wake what sleeps, so that nothing may here."""
    stamps = [gap_ns * (k + 1) for k in range(12)]
    for envs in (1, 2):
        engines = []
        for _ in range(2):
            extras = Extras(joints=True, contacts=True)
            engines.append(MujocoEngine(load_scene(scene, visuals=False), 3, envs, extras=extras))
            engines[-1].model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        recorded, one_by_one = engines
        monkeypatch.setattr(one_by_one._steps, "_take_recorded", lambda course, watch, envs, *_: envs.tolist())
        expected = list(course(one_by_one, stamps))
        assert list(course(recorded, stamps)) == expected
        assert recorded.checked < envs * len(stamps), "steps were taken at once"


def test_a_divergence_is_found_at_its_step(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The steps are taken again, one by one: same time, same words, same start of the next episode."""
    (tmp_path / "fall.xml").write_text(FALL)
    stamps = [20_000_000 * (k + 1) for k in range(8)]
    found = []
    for looked_at in (False, True):
        engine = MujocoEngine(load_scene(str(tmp_path / "fall.xml")), 0, 2, extras=Extras(joints=True, contacts=True))
        if looked_at:
            monkeypatch.setattr(engine._steps, "_take_recorded", lambda course, watch, envs, *_: envs.tolist())
        found.append(list(course(engine, stamps)))
    assert found[0] == found[1]
    assert any(faults for _, _, faults, _ in found[0])


@pytest.mark.parametrize("envs", [1, 3])
def test_what_was_given_stays(envs: int) -> None:
    """Arrays are written again with every interval, but none that somebody has got: those who read them may be late."""
    engine = MujocoEngine(load_scene("cart_pole", visuals=False), 3, envs, extras=Extras(joints=True))
    given, kept = [], []
    for k in range(1, 8):
        found = engine.advance(k * 33_333_333, np.full((envs, 1), 0.1))
        given.append((found.t, found.end_pose, found.moving_pose, found.moving_twist, found.qpos, found.qvel))
        kept.append([array.copy() for array in given[-1]])
        assert len(found.moving) == found.moving_pose.shape[2] > 0
    for arrays, copies in zip(given, kept):
        assert all(np.array_equal(array, copy) for array, copy in zip(arrays, copies))
