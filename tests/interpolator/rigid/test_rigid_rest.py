"""What rests: its frames are the keyframe at next to no cost, and what moves again is as if nothing had been spared."""

from itertools import pairwise

import numpy as np
from rigid_rig import GAP, START, closed_form, keyframe, painted, pose, quad, world

from evis.scene.motion import Linear, Prescribed, Sinusoid
from nodes.interpolator.refine.method import Refined
from nodes.interpolator.rigid import Rigid, RigidOptions
from nodes.renderer.renderer import Renderer

GAPS = 6


class Stops:
    """Moves to the right, stands still for three gaps, and moves on."""

    def pose(self, t_ns):
        """Gives poses float64 [S, 7] at times int64 [S] ns."""
        t = (np.atleast_1d(t_ns) - START) / GAP
        places = np.zeros((len(t), 7))
        places[:, 0] = np.interp(t, [-1, 1, 4, 7], [-0.1, 0.1, 0.1, 0.4])
        places[:, 2], places[:, 6] = 2.0, 1.0
        return places

    def twist(self, t_ns):
        """Gives velocities float64 [S, 6]; nobody here reads them."""
        return np.zeros((len(np.atleast_1d(t_ns)), 6))

    def is_static(self):
        """Tells that it moves."""
        return False


def run(tolerance_ns=0.0, spared=True, path=None):
    """Frames [GAPS, K, h, w] of a wall and something that rests for a while, or goes another path; which gaps rested,
    and further samples."""
    things = [
        (quad(4.0), painted(), Prescribed(pose(z=3.0))),
        (quad(0.4), painted(), path or Stops()),
    ]
    scene = world(things)
    view = scene.cameras[0]
    renderer = Renderer(scene, view)
    rigid = Rigid(scene, view, 1, 4, options=RigidOptions(single=tolerance_ns > 0))
    if not spared:
        rigid._rests = lambda *_: False
    method = Refined(rigid, tolerance_ns) if tolerance_ns else rigid
    keys = []
    for n in range(GAPS + 1):
        t = START + GAP * np.array([n - 1, n])
        states = closed_form(scene, np.linspace(*t, 11).round().astype(np.int64))
        keys.append(keyframe(renderer, states, states.pose[:, -1], int(t[1])))
    frames, rested, further = [], [], []
    for a, b in pairwise(keys):
        out = np.full((1, 4, view.height, view.width), np.nan, np.float32)
        method.between(a, b, [False], out)
        frames.append(out[0])
        rested.append(rigid.rested)
        found = getattr(method, "further", None)
        further.append(None if found is None else [part.numpy().copy() for part in (found.offset, found.value)])
    return np.stack(frames), rested, further


def test_what_rests_is_spared_and_nothing_else_changes():
    frames, rested, _ = run()
    assert sum(rested) == 3 and not rested[0] and not rested[-1]
    whole, none, _ = run(spared=False)
    assert not any(none) and np.array_equal(frames, whole)


def test_samples_between_frames_are_spared_too():
    frames, rested, further = run(100_000)
    whole, _, all_further = run(100_000, spared=False)
    assert sum(rested) == 3 and np.array_equal(frames, whole)
    for one, other in zip(further, all_further):
        assert (one is None) == (other is None)
        assert one is None or all(np.array_equal(a, b) for a, b in zip(one, other))


def test_what_swings_and_is_back_at_every_frame_does_not_rest_between_them():
    """By 0.3 m to and fro: 12 px, over which it hides or shows the wall at every pixel of its borders."""
    swing = Prescribed(pose(0.1, 0, 2.0), [Sinusoid(np.array([0.15, 0.0, 0.0]), 4e9 / GAP, np.pi / 2)])
    frames, rested, _ = run(path=swing)
    assert all(rested[1:]) and (frames == frames[0, 0]).all()
    frames, rested, further = run(100_000, path=swing)
    assert not any(rested) and (frames == frames[0, 0]).all()
    for offset, _ in further:
        # Each turns up in every quarter of the gap, at 32 rows of 12 px.
        counts = np.histogram(offset, 4, (0, GAP))[0]
        assert (counts > 2 * 32 * 12).all()


def test_threads_that_have_nothing_to_do():
    """Something moves, but out of sight."""
    flight = Prescribed(pose(0, 0, -2.0), [Linear(np.array([0.3, 0.0, 0.0]))])
    scene = world([(quad(4.0), painted(), Prescribed(pose(z=3.0))), (quad(0.4), painted(), flight)])
    view = scene.cameras[0]
    renderer, rigid = Renderer(scene, view), Rigid(scene, view, 1, 4, threads=3)
    times = [np.array([START - GAP, START]), np.linspace(START, START + GAP, 5).round().astype(np.int64)]
    a, b = (keyframe(renderer, closed_form(scene, t), None, int(t[-1])) for t in times)
    frames = np.zeros((1, 4, view.height, view.width), np.float32)
    rigid.between(a, b, [False], frames)
    assert (frames == b.image.numpy()[:, None]).all()
