"""Worlds of quads with known motion, their states, and closed forms of what a camera sees."""

import numpy as np

from evis.geometry import pinhole, se3
from evis.scene.model import Body, Camera, Instance, Material, Mesh, Scene
from evis.scene.motion import Linear, Prescribed, Spin
from msgs.header import Header
from msgs.world import WorldState
from nodes.physics.engines.prescribed import PrescribedEngine

WIDTH, HEIGHT, FOCAL = 64, 48, 60.0
KEYFRAME_NS = 33_333_333
Z = np.array([0.0, 0.0, 1.0])
FACING = se3.exp(np.array([np.pi, 0.0, 0.0]))
"""Turns a quad's front, +z, towards a camera that looks along +z."""


def quad(half_x: float, half_y: float) -> Mesh:
    """A rectangle in its frame's x-y plane, seen from +z."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * np.array([half_x, half_y, 1.0])
    return Mesh(corners.astype(np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.int32))


def world(camera_motions=(), model="none", coefficients=(), start=None) -> Scene:
    """A camera at the origin that looks along +z, at a far wall (id 1), a spinning plate (2) and an occluder (3) that
    crosses before it."""
    plate = Prescribed(se3.make_pose(np.array([0.0, 0.0, 2.0]), FACING), [Spin(Z, 7.0)])
    passing = Prescribed(se3.make_pose(np.array([-0.8, 0.0, 1.0]), FACING), [Linear(np.array([8.0, 0.0, 0.0]))])
    eye = Prescribed(se3.IDENTITY if start is None else start, list(camera_motions))
    wall = se3.make_pose(np.array([0.0, 0.0, 5.0]), FACING)
    bodies = [Body("plate", plate), Body("passing", passing), Body("cam0", eye)]
    instances = [
        Instance("wall", -1, quad(9.0, 9.0), 0, wall),
        Instance("plate", 0, quad(0.5, 0.5), 0),
        Instance("passing", 1, quad(0.1, 0.3), 0),
    ]
    k = np.diag([FOCAL, FOCAL, 1.0]) + np.array([[0, 0, 31.5], [0, 0, 23.5], [0] * 3])
    camera = Camera("cam0", WIDTH, HEIGHT, k, distortion_model=model, distortion=tuple(coefficients))
    grey = Material("grey", np.full(3, 0.5, np.float32))
    return Scene("quads", bodies, instances, [grey], [], [camera], np.zeros(3, np.float32))


def states(scene: Scene, count: int, envs: int = 1) -> list[WorldState]:
    """The first states of a scene with prescribed motion."""
    engine, made = PrescribedEngine(scene, envs, accelerations=True), []
    for k in range(count):
        i = engine.advance(k * KEYFRAME_NS) if k else engine.start()
        made.append(
            WorldState(
                Header(k * KEYFRAME_NS),
                i.t,
                i.end_pose,
                i.moving,
                i.moving_pose,
                i.moving_twist,
                np.zeros(envs, np.int32),
                acceleration=i.acceleration,
                names=[b.name for b in scene.bodies],
            )
        )
    return made


def seen(scene: Scene, t: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ids and points in the world [Q, 3] that pixels see at times [Q], by intersecting planes in float64."""
    camera = scene.cameras[0]
    rays = pinhole.unproject(camera.k, np.stack((x, y), -1), np.ones(len(x)))
    eye = scene.bodies[-1].trajectory.pose(t)
    ahead, origin = se3.rotate(eye[:, 3:], rays), eye[:, :3]
    ids, depth = np.zeros(len(t), np.int32), np.full(len(t), np.inf)
    for number, instance in enumerate(scene.instances, 1):
        body = scene.bodies[instance.body].trajectory.pose(t) if instance.body >= 0 else se3.IDENTITY
        frame = se3.compose(np.broadcast_to(body, (len(t), 7)), instance.pose)
        back = se3.inverse(frame)
        start, along = se3.transform(back, origin), se3.rotate(back[:, 3:], ahead)
        with np.errstate(divide="ignore", invalid="ignore"):
            s = -start[:, 2] / along[:, 2]
            hit = start + s[:, None] * along
        half = np.abs(instance.mesh.vertices[0])
        inside = (np.abs(hit[:, 0]) <= half[0]) & (np.abs(hit[:, 1]) <= half[1]) & (s > 0) & (along[:, 2] < 0)
        nearer = inside & (s < depth)
        ids[nearer], depth[nearer] = number, s[nearer]
    return ids, origin + np.where(np.isfinite(depth), depth, 0.0)[:, None] * ahead
