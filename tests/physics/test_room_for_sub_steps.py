"""Sub-steps between two keyframes far apart that do not fit into memory are refused before it is asked for."""

import tracemalloc

import numpy as np
import pytest

from evis.geometry import se3
from evis.scene import load_scene
from evis.scene.model import Body, Scene
from evis.scene.motion import Prescribed, Spin
from nodes.physics import room
from nodes.physics.engines.prescribed import PrescribedEngine
from nodes.physics.room import check_room

REST = se3.make_pose(np.zeros(3), np.array([0, 0, 0, 1.0]))
SECOND = 1_000_000_000


@pytest.fixture
def small_machine(monkeypatch):
    """A gigabyte is free."""
    monkeypatch.setattr(room, "free_host_memory", lambda: 1_000_000_000)


def spinning(bodies):
    paths = [Prescribed(REST, (Spin(np.array([0, 0, 1.0]), 1.0),)) for _ in range(bodies)]
    return Scene("fans", [Body(f"fan{i}", path) for i, path in enumerate(paths)], [], [], [], [], np.zeros(3))


def test_closed_form_is_refused_and_takes_no_memory(small_machine):
    """500 bodies at a kilohertz are 52 MB a second. What nobody looks at is not computed, and not refused."""
    engine = PrescribedEngine(spinning(500), keyframe_rate=1e-3)
    tracemalloc.start()
    with pytest.raises(
        ValueError, match=r"^the states of 500 bodies at the 1000001 sub-steps of 1000 s between two "
    ) as e:
        engine.advance(1000 * SECOND)
    assert tracemalloc.get_traced_memory()[1] < 10_000_000
    tracemalloc.stop()
    assert str(e.value).endswith("of which 1.0 GB are free; a higher keyframe_rate makes it less")
    ends = PrescribedEngine(spinning(500), keyframe_rate=1e-3, inside=lambda: False).advance(1000 * SECOND)
    assert len(ends.t) == 2
    assert len(PrescribedEngine(spinning(50), keyframe_rate=1.0).advance(SECOND).t) == 1001


def test_what_mujoco_moves_is_refused_for_all_environments(small_machine, tmp_path):
    from nodes.physics.engines.mujoco_engine import MujocoEngine

    box = "<body pos='{} 0 1'><freejoint/><geom type='box' size='.1 .1 .1'/></body>"
    world = "".join(box.format(i) for i in range(4))
    (tmp_path / "m.xml").write_text(f"<mujoco><option timestep='.001'/><worldbody>{world}</worldbody></mujoco>")
    engine = MujocoEngine(load_scene(str(tmp_path / "m.xml"), visuals=False), envs=8, threads=1)
    with pytest.raises(ValueError, match="of 4 bodies in 8 environments at the 1000000 sub-steps of 1000 s between"):
        engine.advance(1000 * SECOND)
    assert len(engine.advance(SECOND // 100).t) == 11


def test_a_system_that_tells_nothing_refuses_nothing(monkeypatch):
    monkeypatch.setattr(room, "free_host_memory", lambda: None)
    check_room(SECOND, 10**9, 10**6)
