"""States of environments that share memory, and still bodies that are somewhere else all at once."""

from dataclasses import replace

import numpy as np
from rigid_rig import lamp, painted, plain, pose, quad, world

from evis.scene.motion import Linear, Prescribed, Spin
from msgs.header import Header
from msgs.world import WorldState
from nodes.interpolator.interpolator import Interpolator
from nodes.interpolator.keyframe import States
from nodes.physics.engines.prescribed import PrescribedEngine
from nodes.renderer.renderer import Renderer

GAP = 33_333_333
SHELF = 0
"""Body that stands still."""


def scene():
    things = [
        (quad(3.0), painted(), Prescribed(pose(z=4.0))),
        (quad(0.4), plain(0.7), Prescribed(pose(z=3.0), [Spin(np.array([0, 0, 1.0]), 9.0)])),
        (quad(0.3), plain(0.2), Prescribed(pose(x=-0.5, z=2.5), [Linear(np.array([1.0, 0, 0]))])),
    ]
    return world(things, lights=[lamp()])


def frames(scene, envs, states_of):
    """Frames of three gaps, keyframes by the renderer; states_of: changes the state k of physics."""
    renderer, engine = Renderer(scene, scene.cameras[0], envs), PrescribedEngine(scene, envs, keyframe_rate=30.0)
    interpolator = Interpolator("rigid", 4, scene=scene, camera=scene.cameras[0])
    made = []
    for k in range(4):
        i = engine.advance(k * GAP) if k else engine.start()
        s = states_of(k, States(i.t, i.moving_pose, i.moving_twist, i.moving, i.end_pose))
        out = renderer.render(s.end_pose, None if k == 0 else "last", ("luminance", "depth", "motion"))
        images = (out[n].copy() for n in ("luminance", "depth", "motion"))
        made.append(interpolator.push(k * GAP, np.zeros(envs, np.int32), *images, states=s)[1])
    return made


def dense(states):
    """As they come from another process."""
    return replace(states, pose=states.pose.copy(), twist=states.twist.copy(), rest=np.array(states.rest))


def test_shared_memory_or_not_makes_no_difference():
    assert not PrescribedEngine(scene(), 3).start().end_pose.strides[0]
    shared, copied = frames(scene(), 3, lambda k, s: s), frames(scene(), 3, lambda k, s: dense(s))
    alone = frames(scene(), 1, lambda k, s: s)
    for a, b, c in zip(shared, copied, alone):
        assert a.tobytes() == b.tobytes()
        assert all(a[env].tobytes() == c[0].tobytes() for env in range(3))


def test_a_still_body_that_is_put_elsewhere_between_two_states():
    """By whoever gives the states: within a gap it is where it is at its end, as if all bodies were told."""

    def put(k, states):
        rest = np.array(states.rest)
        if k >= 2:
            rest[:, SHELF, 0] += 0.7
        # Where the states go on from each other, /state says that it moves.
        t = states.t + (1 if k == 2 else 0)
        return replace(states, rest=rest, t=t)

    def told(k, states):
        states = put(k, states)
        every = np.arange(states.rest.shape[1])
        pose = np.repeat(states.rest[:, None], len(states.t), 1)
        twist = np.zeros((*pose.shape[:3], 6))
        pose[:, :, states.moving], twist[:, :, states.moving] = states.pose, states.twist
        return replace(states, pose=pose, twist=twist, moving=every, t=states.t)

    for a, b in zip(frames(scene(), 1, put), frames(scene(), 1, told)):
        assert a.tobytes() == b.tobytes()


def test_a_kept_copy_shares_what_was_shared_and_rows_are_of_the_environments_asked_for():
    interval = PrescribedEngine(scene(), 3, keyframe_rate=30.0).advance(GAP)
    fields = (interval.t, interval.end_pose, interval.moving, interval.moving_pose, interval.moving_twist)
    state = WorldState(Header(GAP), *fields, np.zeros(3, np.int32))
    kept = state.kept_end_pose()
    assert not kept.strides[0] and np.array_equal(kept, state.end_pose)
    assert not np.shares_memory(kept, state.end_pose)
    other = replace(state, end_pose=np.array(state.end_pose))
    other.end_pose[2, 0, 0] = 5.0
    mine = other.kept_end_pose()
    other.end_pose[...] = 0.0
    assert mine[2, 0, 0] == 5.0 and np.array_equal(mine[0], kept[0])
    pose_all, twist_all = state.rows()
    pose_some, twist_some = state.rows([2, 0], np.array([1]))
    assert np.array_equal(pose_some, pose_all[1:2][:, :, [2, 0]])
    assert np.array_equal(twist_some, twist_all[1:2][:, :, [2, 0]])
