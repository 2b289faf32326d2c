"""Further samples of one gap of scenes that are known in closed form."""

import numpy as np
from rigid_rig import GAP, START, closed_form, disc, keyframe, lamp, painted, plain, pose, quad, world

from evis.scene.model import Mesh
from evis.scene.motion import Prescribed, Sinusoid, Spin
from nodes.interpolator.refine.method import Refined
from nodes.interpolator.refine.rounds import Rounds
from nodes.interpolator.rigid import Rigid, RigidOptions
from nodes.renderer.renderer import Renderer


def refined(scene, upsampling, tolerance_ns, threads=1, held=False, margin=0, device="cpu", **options):
    """Frames float32 [K, h, w] and further samples (pixel, ns, value) of one gap from START on."""
    view = scene.cameras[0]
    renderer = Renderer(scene, view, margin=margin)
    times = [np.array([START - GAP, START]), np.linspace(START, START + GAP, 11).round().astype(np.int64)]
    first, second = (closed_form(scene, t) for t in times)
    a = keyframe(renderer, first, first.pose[:, 0], START)
    b = keyframe(renderer, second, first.pose[:, -1], START + GAP)
    out = np.full((1, upsampling, view.height, view.width), np.nan, np.float32)
    how = RigidOptions(**options, single=True)
    rigid = Rigid(scene, view, 1, upsampling, margin, device=device, threads=threads, options=how)
    if not tolerance_ns:
        rigid.between(a, b, [held], out)
        return out[0], None
    method = Refined(rigid, tolerance_ns, threads)
    method.between(a, b, [held], out)
    found = method.further
    if found is None:
        return out[0], None
    starts = found.first.numpy()
    assert starts[0] == 0 and starts[-1] == found.offset.size
    pixels = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    return out[0], (pixels, found.offset.numpy(), found.value.numpy())


def keyframes_of_gap(scene, envs=1, paths=()):
    """Both keyframes of a gap of all environments; paths: of the last body, by environment."""
    renderer = Renderer(scene, scene.cameras[0], envs)
    keys = []
    for t in (np.array([START - GAP, START]), np.linspace(START, START + GAP, 11).round().astype(np.int64)):
        states = closed_form(scene, t)
        states.pose, states.twist = (np.repeat(a, envs, 0) for a in (states.pose, states.twist))
        for env, path in enumerate(paths):
            states.pose[env, :, 1], states.twist[env, :, 1] = path.pose(t), path.twist(t)
        keys.append(keyframe(renderer, states, None, int(t[-1])))
    return keys


def parts_of(scene, upsampling=4, tolerance_ns=20_000, envs=1):
    """Parts of a coarse interval of one gap, and whether something is too fast for them."""
    view = scene.cameras[0]
    keys = keyframes_of_gap(scene, envs)
    rigid = Rigid(scene, view, envs, upsampling, options=RigidOptions(single=True))
    method, parts = Refined(rigid, tolerance_ns), []
    run = Rounds.run
    Rounds.run = lambda self, window, *given: (parts.append(window.params.parts), run(self, window, *given))[1]
    try:
        method.between(*keys, np.zeros(envs, bool), np.empty((envs, upsampling, view.height, view.width), np.float32))
    finally:
        Rounds.run = run
    assert len(set(parts)) == 1
    return parts[0], bool(method.refinement.unseen.any())


def box(half):
    """Box with sides 2 half."""
    x, y, z = half
    corners = np.array([(i, j, k) for i in (-x, x) for j in (-y, y) for k in (-z, z)], np.float32)
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([f for a, b, c, d in sides for f in ((a, b, c), (a, c, d))], np.int32)
    return Mesh(corners, faces)


def tumbling(**how):
    """A textured disc that turns and swings before a wall, and a lit box that tumbles before both."""
    turn, up = np.array([0.0, 0.0, 1.0]), np.array([0.3, 1.0, 0.2]) / np.linalg.norm([0.3, 1.0, 0.2])
    swing = [Spin(turn, 60.0), Sinusoid(np.array([0.2, 0.1, 0.3]), 20.0)]
    things = [
        (quad(4.0), painted(1024), Prescribed(pose(z=3.0))),
        (disc(0.5), painted(), Prescribed(pose(0, 0, 2, (0.6, 0, 0)), swing)),
        (box((0.1, 0.3, 0.1)), plain(0.7), Prescribed(pose(0.2, 0, 1.2), [Spin(up, 90.0)])),
    ]
    return world(things, **{"lights": [lamp()], **how})
