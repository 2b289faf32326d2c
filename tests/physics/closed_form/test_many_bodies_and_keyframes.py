"""States of many bodies and of many keyframes at once are, to the bit, those of each body at each time by itself."""

import tracemalloc

import numpy as np
import pytest

from evis.bus.local import LocalPublisher
from evis.geometry import se3
from evis.runtime.clock import keyframe_stamp
from evis.scene.load import load_scene
from evis.scene.model import Body, Scene
from evis.scene.motion import Linear, Path, Prescribed, Sinusoid, Spin, Swing, Turn
from evis.scene.prescribed_batch import PrescribedBatch
from evis.scene.spline import Spline
from evis.simulation.simulation import Simulation
from msgs.codec import decode, encode
from msgs.header import Header
from msgs.world import WorldState
from nodes.physics.closed_form.ahead import BLOCK
from nodes.physics.engines.prescribed import PrescribedEngine, PrescribedStates
from nodes.physics.interval import grid_inside


def drawn_paths(count: int, seed: int) -> list[Prescribed]:
    """All kinds of motion, chained in any way, on carriers that move or do not."""
    rng = np.random.default_rng(seed)
    laps = np.array([0, 0.4, 1.1, 2.0]), np.array([0, 0.5, 0.9, 3.1])
    paths: list[Prescribed] = []
    for _ in range(count):
        start = se3.make_pose(rng.normal(size=3), se3.normalize(rng.normal(size=4)))
        motions = []
        for which in rng.integers(0, 6, rng.integers(0, 4)):
            axis, number = rng.normal(size=3), rng.uniform(-3, 3, 3)
            axis /= np.linalg.norm(axis)
            times, loop = laps[rng.integers(2)], bool(rng.integers(2))
            motions.append(
                [
                    lambda n=number: Linear(n),
                    lambda n=number: Sinusoid(n, abs(n[0]), n[1]),
                    lambda a=axis, n=number: Spin(a, n[0]),
                    lambda a=axis, n=number: Swing(a, *n),
                    lambda t=times, p=loop: Path(Spline(t, rng.normal(size=(4, 3)), p)),
                    lambda t=times, p=loop, a=axis: Turn(a, Spline(t, rng.normal(size=(4, 1)), p)),
                ][which]()
            )
        parent = paths[rng.integers(len(paths))] if paths and rng.random() < 0.6 else None
        paths.append(Prescribed(start, motions, parent))
    return paths


@pytest.mark.parametrize("count", [1, 2, 7, 60])
def test_many_bodies_are_as_each_by_itself(count):
    paths = drawn_paths(count, seed=count)
    t = np.concatenate([[0, 1], np.sort(np.random.default_rng(1).integers(0, 10**11, 301))])
    batch = PrescribedBatch(paths)
    pose, twist = batch.at(t)
    assert batch.poses_at(t).tobytes() == pose.tobytes()
    assert pose.shape == (303, count, 7) and twist.shape == (303, count, 6)
    for n, path in enumerate(paths):
        for part in (slice(0, 1), slice(1, 35), slice(0, 303)):
            assert pose[part, n].tobytes() == path.pose(t[part]).tobytes()
            assert twist[part, n].tobytes() == path.twist(t[part]).tobytes()


def test_carriers_that_are_no_bodies_themselves_and_none_at_all():
    arm = drawn_paths(9, 5)
    pose, _ = PrescribedBatch([arm[8], arm[3]]).at(np.array([5, 6]))
    assert pose[:, 1].tobytes() == arm[3].pose(np.array([5, 6])).tobytes()
    assert PrescribedBatch([]).at(np.array([5, 6]))[0].shape == (2, 0, 7)


class Corkscrew:
    """A trajectory of somebody else's kind."""

    def pose(self, t_ns):
        return se3.make_pose(np.outer(t_ns * 1e-9, [0, 0, 1.0]), se3.exp(np.outer(t_ns * 1e-9, [0, 0, 2.0])))

    def twist(self, t_ns):
        return np.tile([0, 0, 1.0, 0, 0, 2.0], (len(t_ns), 1))

    def is_static(self):
        return False


def test_other_trajectories_go_among_them():
    known = drawn_paths(3, 2)
    bodies = [Body("a", known[0]), Body("screw", Corkscrew()), Body("b", known[2])]
    states = PrescribedStates(Scene("mixed", bodies, [], [], [], [], np.ones(3)))
    t = np.array([0, 3, 10**9])
    pose, twist = states.at(t)
    for n, body in enumerate(bodies):
        assert pose[:, n].tobytes() == body.trajectory.pose(t).tobytes()
        assert np.array_equal(twist[:, n], body.trajectory.twist(t))


@pytest.mark.parametrize("rate", [30.0, 1000 / 3, 1000.0, 7777.7])
def test_keyframes_ahead_are_as_one_by_one(rate):
    """From stamp to stamp with all sub-steps, after a rewind, and anew for some of the environments."""
    scene = load_scene("warehouse", textures=False)
    engine, paths = PrescribedEngine(scene, 2, keyframe_rate=rate), [b.trajectory for b in scene.bodies]
    engine.start()
    for turn in (engine, engine, engine.anew([1], [None], [1])):
        turn.rewind(0)
        for k in range(1, 40):
            before, stamp = keyframe_stamp(k - 1, rate), keyframe_stamp(k, rate)
            interval = turn.advance(stamp)
            assert interval.t.tolist() == [before, *grid_inside(before, stamp, scene.timestep_ns).tolist(), stamp]
            if k not in (1, 2, 4, 9, 39):
                continue
            for place, n in enumerate(interval.moving):
                assert interval.moving_pose[-1, :, place].tobytes() == paths[n].pose(interval.t).tobytes()
                assert interval.moving_twist[0, :, place].tobytes() == paths[n].twist(interval.t).tobytes()
            assert np.array_equal(interval.end_pose[:, interval.moving], interval.moving_pose[:, -1])


def test_stamps_that_are_not_foreseen():
    """As another rate has them, in between, and further on than expected."""
    scene = load_scene("spinning_disk", textures=False)
    foreseeing, other = PrescribedEngine(scene, keyframe_rate=30.0), PrescribedEngine(scene)
    for stamp in (33_333_333, 66_666_667, 70_000_000, 100_000_000, 133_333_333, 10**9, 1_033_333_333):
        a, b = foreseeing.advance(stamp), other.advance(stamp)
        for name in ("t", "end_pose", "moving_pose", "moving_twist"):
            assert getattr(a, name).tobytes() == getattr(b, name).tobytes()


def test_what_is_computed_ahead_is_bounded():
    """All engines of a run together hold no more than a block and an interval each, however long they go on."""
    scene = load_scene("warehouse", textures=False)
    engines = [PrescribedEngine(scene, 1, keyframe_rate=30.0, beside=8) for _ in range(8)]
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for k in range(1, 16):
        for engine in engines:
            moving = engine.advance(keyframe_stamp(k, 30.0)).moving
    held = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert held < 1.1 * (BLOCK + 8 * 35 * len(moving) * 13 * 8)


def test_states_of_environments_that_move_alike_are_published_without_a_copy():
    """Within a process; what a recorder in another one would get is the same."""
    engine = PrescribedEngine(load_scene("spinning_disk", textures=False), 64, keyframe_rate=30.0)
    engine.start()
    interval = engine.advance(33_333_333)
    state = WorldState(Header(33_333_333), interval.t, interval.end_pose, interval.moving, interval.moving_pose,
                       interval.moving_twist, np.zeros(64, np.int32))  # fmt: skip
    publisher = LocalPublisher("/state", "physics", WorldState)
    publisher.send(state)
    assert np.shares_memory(state.moving_pose[0], state.moving_pose[63]) and not state.moving_pose.flags.writeable
    frames = [bytes(frame) for frame in encode(state)]
    got = decode(frames, WorldState)
    for name in ("t", "end_pose", "moving_pose", "moving_twist"):
        assert np.array_equal(getattr(got, name), getattr(state, name))
    publisher.close()


@pytest.mark.parametrize(("outputs", "most"), [(["events"], 10), (["events", "state"], 200)])
def test_sub_steps_that_nobody_reads_are_left_out(outputs, most, monkeypatch):
    """Of a graph of events alone; where the caller takes the states they are all there."""
    computed, of_moving = [], PrescribedStates.of_moving
    monkeypatch.setattr(PrescribedStates, "of_moving", lambda self, t: computed.append(t) or of_moving(self, t))
    with Simulation("spinning_disk", width=16, height=12, audit=0, outputs=outputs) as sim:
        sim.reset(seed=0)
        steps = [sim.step() for _ in range(3)]
    count = sum(map(len, computed))
    assert most / 2 < count <= most
    for step in steps[: most // 100]:
        assert len(step.state.t) == 35 and step.state.moving_pose.shape[1] == 35
