"""Defines a scene as all nodes see it: bodies that move, the instances they carry, materials, lights, cameras.

Units are SI, angles radians, colours linear Rec. 709. A pose is float64 [7]: position [m], quaternion x y z w.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from evis.scene.draws import Drawn
from evis.scene.folders import Folders

MODELS = (".xml", ".urdf")
"""Files of MuJoCo's own reader, which are scenes by themselves."""
WORLD = -1
"""Body index of the static world."""


class Trajectory(Protocol):
    """Prescribes a motion in closed form."""

    def pose(self, t_ns: np.ndarray) -> np.ndarray:
        """Computes the poses float64 [S, 7] at times int64 [S] ns."""

    def twist(self, t_ns: np.ndarray) -> np.ndarray:
        """Computes the linear and angular velocity float64 [S, 6], world frame."""

    def is_static(self) -> bool:
        """Returns True when the pose never changes."""


@dataclass
class Body:
    """Describes something with a pose. trajectory is None for a body that the physics engine moves."""

    name: str
    trajectory: Trajectory | None
    mount: tuple[int, np.ndarray] | None = None
    """Rigid on a body that the physics engine moves (a camera on a robot): (its index, pose in its frame)."""
    follows: tuple[str, int] | None = None
    """Moved by MuJoCo's rule for a camera or light that tracks or targets a body: (`camera` or `light`, its number)."""


@dataclass(frozen=True)
class Roundness:
    """Tells how a mesh departs from the curved surface that it stands for.

    error: how far its outlines lie within the true ones at most [m]. finer: makes the same with n times as many sides,
    whose error is n^2 times less. radius: of the ball about the frame's origin that holds it [m].
    """

    error: float
    finer: Callable[[int], Mesh]
    radius: float


@dataclass
class Mesh:
    """Holds triangles in the body's frame of one instance.

    vertices float32 [V, 3] m; faces int32 [F, 3], counter-clockwise seen from outside; uv float32 [F, 3, 2] per corner
    or None; normals float32 [F, 3, 3] per corner (smooth shading) or None (flat); colours float32 [F, 3, 3] per corner,
    linear, 0 ... 1, by which the material's albedo is multiplied, or None (1).
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray | None = None
    normals: np.ndarray | None = None
    colours: np.ndarray | None = None
    round: Roundness | None = None
    """Where flat triangles stand for a curved surface that code can make finer."""

    @property
    def nbytes(self) -> int:
        """Returns the memory of the arrays [bytes]."""
        arrays = (self.vertices, self.faces, self.uv, self.normals, self.colours)
        return sum(array.nbytes for array in arrays if array is not None)


@dataclass
class Material:
    """Describes how a surface reflects and emits light. albedo: linear reflectance [3], times texture (float32 [h, w,
    3], linear, row 0 at v = 1) where there is one.

    emission: radiance [3] in W/(sr m^2), added. roughness and metallic as in glTF, for the GGX term.
    two_sided: the back of a triangle is shaded like its front.
    """

    name: str
    albedo: np.ndarray
    texture: np.ndarray | None = None
    emission: np.ndarray = field(default_factory=lambda: np.zeros(3, np.float32))
    roughness: float = 1.0
    metallic: float = 0.0
    two_sided: bool = False


@dataclass
class Instance:
    """Places a mesh with a material rigidly on a body. Its id in the ids image is its index in Scene.instances + 1."""

    name: str
    body: int
    mesh: Mesh
    material: int
    pose: np.ndarray = field(default_factory=lambda: np.array([0, 0, 0, 0, 0, 0, 1.0]))
    """Instance to body."""
    semantic: str = ""
    """What kind of thing it is, the class that semantic ids tell; "" = as its name."""


@dataclass(frozen=True)
class Waveform:
    """Describes how a light's strength varies in time, with a mean of 1: mains flicker, PWM.

    kind `sine`: 1 + depth sin(2 pi (frequency t + phase)). kind `square`: 1 + depth (1 - duty) / duty for the first
    `duty` of each period, 1 - depth after it. phase in periods, frequency in Hz, depth 0 ... 1.
    """

    kind: str
    frequency: float
    depth: float = 1.0
    phase: float = 0.0
    duty: float = 0.5


@dataclass
class Light:
    """Describes a light. kind `directional`: `colour` is irradiance [W/m^2] on a surface facing it, `vector` the
    direction light travels.

    kind `point`: `colour` is radiant intensity [W/sr], `vector` the position [m]. kind `spot`: as point, within a cone
    about `direction`: full inside the half-angle cone[0], none outside cone[1] [rad]. kind `area`: a rectangle about
    `vector` with half-edges `half_u` and `half_v` [m] that emits `colour`, a radiance [W/(sr m^2)], to the side of
    half_u x half_v. body: what it is fixed to.
    """

    name: str
    kind: str
    colour: np.ndarray
    vector: np.ndarray
    body: int = WORLD
    shadows: bool = True
    direction: np.ndarray | None = None
    cone: tuple[float, float] = (0.0, 0.0)
    half_u: np.ndarray | None = None
    half_v: np.ndarray | None = None
    waveform: Waveform | None = None


@dataclass
class Camera:
    """Describes a pinhole camera; its pose is that of the body of the same name (looking along +z, x right, y down)."""

    name: str
    width: int
    height: int
    k: np.ndarray
    """Intrinsic matrix float64 [3, 3] px; pixel (0, 0) is the centre of the top-left pixel."""
    near: float = 1e-3
    """Near plane [m]."""
    distortion_model: str = "none"
    """`none`, `plumb_bob` (Brown-Conrady k1 k2 p1 p2 k3 [k4 k5 k6]) or `equidistant` (Kannala-Brandt k1 ... k4)."""
    distortion: tuple[float, ...] = ()
    supersampling: int = 1
    """Samples per pixel along each axis."""
    rate: float | None = None
    """Keyframes per second, for one that has not the rate of the others [Hz]."""


@dataclass(frozen=True)
class JointStart:
    """Says between which bounds a hinge or slide starts, drawn evenly by the seed: rad or m, and rad/s or m/s."""

    position: tuple[float, float] | None = None
    """None = where the model has it."""
    velocity: tuple[float, float] | None = None


@dataclass(frozen=True)
class ModelChange:
    """Describes a value of a MuJoCo model that a scene sets: of which kind of element, its number, and what of it."""

    kind: str
    number: int
    key: str
    values: tuple[float, ...]


@dataclass(frozen=True)
class AddedActuator:
    """Describes an actuator that a scene adds to a joint of its model.

    kind: `position`, `velocity` or `motor`. gain and damping in N m or N per unit of joint, control or speed. range: of
    the control, None where it has none.
    """

    joint: str
    kind: str
    gain: float
    damping: float
    range: tuple[float, float] | None


@dataclass
class Scene:
    """Holds a whole scene. bodies[n] is entry n of WorldState; every camera has a body of its name among them."""

    name: str
    bodies: list[Body]
    instances: list[Instance]
    materials: list[Material]
    lights: list[Light]
    cameras: list[Camera]
    environment: np.ndarray
    """Radiance [3] of the sky, also the ambient light."""
    mjcf: Path | None = None
    """The MuJoCo model, for a scene with dynamics."""
    folders: Folders | None = None
    """Where the files that the model names may lie."""
    keyframe: int = -1
    """Dynamics: number of the model's keyframe that is the start, -1 for its reference pose."""
    changes: list[ModelChange] = field(default_factory=list)
    """Dynamics: what of the model is other than its file says."""
    actuators: list[AddedActuator] = field(default_factory=list)
    """Dynamics: those that the model's joints have beside the model's own."""
    timestep_ns: int = 1_000_000
    """Sub-step of /state for prescribed motion [ns]."""
    initial_spread: tuple[float, float] = (0.0, 0.0)
    """Dynamics: how far the seed shifts [m] and turns [rad] free bodies at the start, standard deviations."""
    initial_joints: dict[str, JointStart] = field(default_factory=dict)
    """Dynamics: joints by name that the seed puts to their start."""
    notes: list[str] = field(default_factory=list)
    """What of the scene's source is not simulated, one line each; who moves the bodies tells."""
    left_out: list[str] = field(default_factory=list)
    """What of its looks is not drawn, which is known where they are loaded, one line each; who draws tells."""
    environment_map: np.ndarray | None = None
    """Radiance of the sky by direction, in place of `environment`: float32 [h, w, 3], equirectangular, row 0 up (+z),
    column 0 at +x turning to +y."""
    sky_lights: bool = True
    """False: `environment_map` is seen behind everything, and what lights surfaces from afar is `environment`."""
    sensor: dict[str, Any] = field(default_factory=dict)
    """Parameters of the event sensor that are other than its preset's, by name; who has a sensor checks them."""
    drawn: list[Drawn] = field(default_factory=list)
    """Values that the environment's seed has decided; what of the file was not read is not among them."""
    shared: bool = False
    """True where the nodes of a process have it in common: nobody writes to it, and they share what is made of it."""

    @property
    def dynamic(self) -> bool:
        """Tells whether a physics engine is needed."""
        return self.mjcf is not None

    def body_index(self, name: str) -> int:
        """Returns the index of a body by name. Raises KeyError."""
        for index, body in enumerate(self.bodies):
            if body.name == name:
                return index
        raise KeyError(f"scene {self.name} has no body '{name}'")

    def camera(self, name: str) -> Camera:
        """Returns a camera by name. Raises KeyError naming those there are."""
        for camera in self.cameras:
            if camera.name == name:
                return camera
        raise KeyError(f"scene {self.name} has no camera '{name}'; it has {', '.join(c.name for c in self.cameras)}")
