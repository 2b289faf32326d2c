"""Defines the messages of one camera: what it is, what renderer, interpolator and sensor make of it.

Image arrays lead with E (environments). With an over-render margin, H and W include `margin` pixels on every side.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from msgs.fields import MessageError, array, array_specs
from msgs.header import Header, Message
from msgs.own_time import own_rows

INTERVAL_FLOWS = ("forward_flow", "backward_flow")
"""Labels that say where points get to over an interval [px]."""
FLOWS = ("flow", *INTERVAL_FLOWS)
"""Labels of optical flow; `flow` is a velocity [px/s]."""


@dataclass
class CameraInfo(Message):
    """Describes a camera; latched. Pixel (0, 0) is the top-left pixel's centre; x right, y down, z forward."""

    header: Header
    k: np.ndarray = array("float64", "3 3", "intrinsic matrix [px], of the image without margin")
    distortion: np.ndarray = array("float64", "?", "coefficients of distortion_model, may be empty")
    name: str = "cam0"
    width: int = 0
    height: int = 0
    margin: int = 0
    envs: int = 1
    distortion_model: str = "none"
    clock: str = "sim"
    keyframe_rate: float = 0.0
    upsampling: int = 0
    instances: list[str] = field(default_factory=list)
    """Name of each id in Ids; entry 0 is the background."""
    instance_bodies: list[str] = field(default_factory=list)
    """Name of the body that each instance moves with; "" for the static world."""
    semantic: np.ndarray | None = array("int32", "?", "semantic id of each instance id", optional=True)
    classes: list[str] = field(default_factory=list)
    """Name of each semantic id; entry 0 is the background."""
    baseline: float = 0.0
    """How far it stands to the right of the first camera of its stereo rig [m]; 0 for any other."""
    sensor: dict[str, Any] = field(default_factory=dict)
    """Sensor parameters and identity (threshold, preset, serial, firmware, ...)."""
    env_k: np.ndarray | None = array("float64", "E 3 3", "k of each environment where cameras differ", optional=True)
    env_distortion: np.ndarray | None = array("float64", "E ?", "distortion of each, with env_k", optional=True)
    env_baseline: np.ndarray | None = array("float64", "E", "baseline of each, with env_k [m]", optional=True)
    drawn: dict[str, Any] = field(default_factory=dict)
    """What of the world the seed has decided: name of the place in the scene file -> a value for each environment."""


@dataclass
class CameraSettings(Message):
    """Asks a camera that streams to change settings, as soon as the message arrives: all of them, or none where one is
    refused. What the camera has from then on is on its info topic."""

    header: Header
    values: dict[str, Any] = field(default_factory=dict)
    """Name -> value, as `evis camera info --settings` lists them: a number, true or false, or the text of one."""


@dataclass
class Keyframe(Message):
    """Carries scene-linear light at header.stamp_ns.

    Radiance, Rec. 709 primaries, or its luminance where nobody reads colour.

    A supersampled one whose samples are to be moved before they are averaged is larger than the camera by a whole
    number of times, its margin too.
    """

    VERSION: ClassVar[int] = 2
    header: Header
    episodes: np.ndarray = array("int32", "E", "episode of each environment")
    radiance: np.ndarray | None = array("float32|float16", "E H W 3", "[W/(sr m^2)], linear", optional=True)
    luminance: np.ndarray | None = array("float32|float16", "E H W", "[W/(sr m^2)], Rec. 709", optional=True)
    own: np.ndarray | None = own_rows()
    margin: int = 0

    @property
    def image(self) -> np.ndarray:
        """Returns the radiance [E, H, W, 3] or, without it, the luminance [E, H, W].

        Raises MessageError where both lack.
        """
        found = self.luminance if self.radiance is None else self.radiance
        if found is None:
            raise MessageError("Keyframe has neither radiance nor luminance")
        return found

    @property
    def rgb(self) -> np.ndarray:
        """Returns the radiance, or a grey view [E, H, W, 3] of the luminance, for pictures; of numpy arrays only."""
        image = self.image
        return image if image.ndim == 4 else np.broadcast_to(image[..., None], (*image.shape, 3))


@dataclass
class Depth(Message):
    """Carries the distance along the optical axis."""

    header: Header
    depth: np.ndarray = array("float32", "E H W", "z [m], +inf = sky")
    margin: int = 0


@dataclass
class Motion(Message):
    """Carries backward motion: where the surface point was at the previous keyframe minus where it is now."""

    header: Header
    motion: np.ndarray = array("float32", "E H W 2", "(dx, dy) [px]")
    margin: int = 0


@dataclass
class Ids(Message):
    """Carries the instance seen by each pixel; CameraInfo.instances names them."""

    header: Header
    ids: np.ndarray = array("int32", "E H W", "0 = background")
    margin: int = 0


@dataclass
class Normal(Message):
    """Carries the geometric surface normal in the world frame."""

    header: Header
    normal: np.ndarray = array("float32", "E H W 3", "unit vector towards the camera, 0 = sky")
    margin: int = 0


@dataclass
class Frames(Message):
    """Carries linear luminance (or RGB) at K times of the gap (previous stamp, header.stamp_ns], margin cropped.

    The first message of an episode has K = 1 and sets the sensor's reference. Environments that begin one while others
    go on have the keyframe at header.stamp_ns in all K frames.
    """

    header: Header
    t: np.ndarray = array("int64", "K", "[ns], ascending, the last is header.stamp_ns")
    episodes: np.ndarray = array("int32", "E", "episode of each environment")
    luminance: np.ndarray | None = array("float32", "E K H W", "linear, Rec. 709", optional=True)
    rgb: np.ndarray | None = array("float32", "E K H W 3", "linear, for colour events", optional=True)
    own: np.ndarray | None = own_rows()
    own_t: np.ndarray | None = array("int64", "E K", "stamps of the frames in own time [ns]", optional=True)
    filled: int = 0
    """Pixels that no keyframe saw and that were filled from a neighbouring surface."""
    reshaded: int = 0
    """Pixels that were shaded at their own time, for the keyframes do not show them in full."""


@dataclass
class Samples(Message):
    """Carries what Frames does and, between the frames, further samples of single pixels.

    Between two neighbouring samples of a pixel, of a frame or further, ln I is a straight line. Pixel (y, x) of
    environment e, q = (e H + y) W + x, has the further samples first[q] to first[q + 1] - 1, in the order of time, none
    of them at the stamp of a frame. Environments that begin an episode have none before their first frame.
    """

    header: Header
    t: np.ndarray = array("int64", "K", "stamps of the frames [ns], ascending, the last is header.stamp_ns")
    episodes: np.ndarray = array("int32", "E", "episode of each environment")
    first: np.ndarray = array("int32", "?", "[E H W + 1] where the further samples of each pixel begin")
    offset: np.ndarray = array("int32", "R", "[ns] after the gap's start, the stamp before t[0]")
    luminance: np.ndarray | None = array("float32", "E K H W", "of the frames, linear, Rec. 709", optional=True)
    rgb: np.ndarray | None = array("float32", "E K H W 3", "of the frames, linear, for colour events", optional=True)
    further: np.ndarray | None = array("float32", "R", "luminance of the further samples", optional=True)
    further_rgb: np.ndarray | None = array("float32", "R 3", "RGB of the further samples", optional=True)
    own: np.ndarray | None = own_rows()
    own_t: np.ndarray | None = array("int64", "E K", "stamps of the frames in own time [ns]", optional=True)
    filled: int = 0
    """Pixels that no keyframe saw and that were filled from a neighbouring surface."""
    reshaded: int = 0
    """Pixels that were shaded at their own time, for the keyframes do not show them in full."""

    def check(self) -> None:
        """Checks as every message does; also raises MessageError unless `first` and `offset` are those of pixels."""
        super().check()
        image = self.luminance if self.rgb is None else self.rgb
        pixels = None if image is None else image.shape[0] * image.shape[2] * image.shape[3]
        first, offset = np.asarray(self.first, np.int64), np.asarray(self.offset, np.int64)
        if pixels is not None and len(first) != pixels + 1:
            raise MessageError(f"Samples.first has {len(first)} entries, {pixels} pixels take {pixels + 1}")
        if not len(first) or first[0] != 0 or first[-1] != len(offset) or (np.diff(first) < 0).any():
            raise MessageError(f"Samples.first does not ascend from 0 to the {len(offset)} further samples")
        pixel_begins = np.isin(np.arange(1, len(offset)), first)
        if (offset <= 0).any() or not (pixel_begins | (np.diff(offset) > 0)).all():
            raise MessageError("Samples.offset does not ascend from above 0 within each pixel")

    def of(self, envs: slice) -> Samples:
        """Returns the samples of some neighbouring environments, as a message of these alone; of numpy arrays only."""
        specs, arrays = array_specs(Samples), self.arrays()
        cut: dict[str, Any] = {name: array[envs] for name, array in arrays.items() if specs[name].dims[0] == "E"}
        pixels = (len(self.first) - 1) // max(len(self.episodes), 1)
        first = self.first[envs.start * pixels : envs.stop * pixels + 1]
        own = slice(int(first[0]), int(first[-1]))
        cut |= {name: array[own] for name, array in arrays.items() if specs[name].dims[0] == "R"}
        return replace(self, **(cut | {"first": first - first[:1]}))


@dataclass
class EventPacket(Message):
    """Carries the events of one interval: decoded arrays, the sensor's own bytes (`encoding`, `raw`), or both.

    Simulated events are sorted by t, then y, x and lie in (t0_ns, header.stamp_ns], those of an environment that was
    reset by itself up to 1 ns beside it; a real sensor's order is kept as it came. `lost` counts events or bytes known
    to be missing before this packet.
    """

    header: Header
    env_offsets: np.ndarray = array("int64", "?", "[E + 1] events of environment e are [offsets[e], offsets[e + 1])")
    t: np.ndarray | None = array("int64", "n", "[ns]", optional=True)
    x: np.ndarray | None = array("uint16", "n", "column", optional=True)
    y: np.ndarray | None = array("uint16", "n", "row", optional=True)
    p: np.ndarray | None = array("uint8", "n", "1 = ON, 0 = OFF", optional=True)
    c: np.ndarray | None = array("uint8", "n", "colour channel 0 R, 1 G, 2 B", optional=True)
    raw: np.ndarray | None = array("uint8", "?", "wire bytes of the sensor", optional=True)
    width: int = 0
    height: int = 0
    t0_ns: int = 0
    encoding: str = ""
    """Encoding of `raw` (`evt3`, `evt2`, ...); empty where the packet has none."""
    lost: int = 0

    def check_values(self) -> None:
        """Raises MessageError unless env_offsets divide the decoded events among environments."""
        if self.t is not None:
            _check_offsets("EventPacket", self.env_offsets, self.t)


@dataclass
class EventSignal(Message):
    """Tells of each event of the packet of the same stamp whether light made it, or noise."""

    header: Header
    env_offsets: np.ndarray = array("int64", "?", "[E + 1] as of the packet")
    signal: np.ndarray = array("uint8", "n", "1 = made by light, 0 = by noise")

    def check_values(self) -> None:
        """Raises MessageError unless env_offsets divide the events among environments."""
        _check_offsets("EventSignal", self.env_offsets, self.signal)


def _check_offsets(message: str, offsets: np.ndarray, column: np.ndarray) -> None:
    """Raises MessageError unless each event of a column is of one environment; readers would lose or repeat others."""
    if not isinstance(offsets, np.ndarray):
        return  # on a device, and looked at there by nobody
    count = len(column)
    fit = len(offsets) > 0 and offsets[0] == 0 and offsets[-1] == count
    if not fit or (len(offsets) > 2 and (offsets[1:] < offsets[:-1]).any()):
        raise MessageError(
            f"{message}.env_offsets is {offsets.tolist()!s:.80}, and must go up from 0 to the number of events, {count}"
        )


@dataclass
class Labels(Message):
    """Carries ground truth at header.stamp_ns, the stamp of an event packet. Only what was asked for is present.

    The rows event_... are those of the packet's events, in its order: its env_offsets hold for them too.
    """

    header: Header
    flow: np.ndarray | None = array("float32", "E H W 2", "forward optical flow [px/s], NaN = unknown", optional=True)
    depth: np.ndarray | None = array("float32", "E H W", "z [m], +inf = sky", optional=True)
    segmentation: np.ndarray | None = array("int32", "E H W", "instance ids", optional=True)
    semantic: np.ndarray | None = array("int32", "E H W", "semantic ids, named in CameraInfo.classes", optional=True)
    box: np.ndarray | None = array("float32", "B 4", "x0 y0 x1 y1 [px], visible extent, inclusive", optional=True)
    box_env: np.ndarray | None = array("int32", "B", "environment of each box", optional=True)
    box_id: np.ndarray | None = array("int32", "B", "instance id of each box", optional=True)
    pose: np.ndarray | None = array("float64", "E N 7", "body poses (p, q xyzw), world", optional=True)
    velocity: np.ndarray | None = array("float64", "E N 6", "body twists (v, omega), world", optional=True)
    acceleration: np.ndarray | None = array("float64", "E N 6", "(a, alpha) of the bodies, world", optional=True)
    qpos: np.ndarray | None = array("float64", "E nq", "joint positions", optional=True)
    qvel: np.ndarray | None = array("float64", "E nv", "joint velocities", optional=True)
    forward_flow: np.ndarray | None = array("float32", "E H W 2", "from flow_t[0] to [1] [px]", optional=True)
    forward_valid: np.ndarray | None = array("uint8", "E H W", "1 = in view at both, not covered", optional=True)
    backward_flow: np.ndarray | None = array("float32", "E H W 2", "from flow_t[1] to [0] [px]", optional=True)
    backward_valid: np.ndarray | None = array("uint8", "E H W", "1 = in view at both, not covered", optional=True)
    flow_t: np.ndarray | None = array("int64", "2", "instants of forward and backward flow [ns]", optional=True)
    event_env: np.ndarray | None = array("int32", "n", "environment of each event", optional=True)
    event_instance: np.ndarray | None = array("int32", "n", "instance id, 0 = background", optional=True)
    event_flow: np.ndarray | None = array("float32", "n 2", "flow there and then [px/s], NaN = unknown", optional=True)
    event_signal: np.ndarray | None = array("uint8", "n", "1 = made by light, 0 = by noise", optional=True)
    box3d_env: np.ndarray | None = array("int32", "C", "environment of each oriented box", optional=True)
    box3d_id: np.ndarray | None = array("int32", "C", "instance id of each", optional=True)
    box3d_size: np.ndarray | None = array("float64", "C 3", "lengths along its axes [m]", optional=True)
    box3d_pose: np.ndarray | None = array("float64", "C 7", "centre and orientation (p, q xyzw), world", optional=True)
    box3d_in_camera: np.ndarray | None = array("float64", "C 7", "the same in the camera's frame", optional=True)
    contact_env: np.ndarray | None = array("int32", "M", "environment of each contact", optional=True)
    contact_body: np.ndarray | None = array("int32", "M 2", "body indices, -1 = world", optional=True)
    contact_position: np.ndarray | None = array("float64", "M 3", "[m], world", optional=True)
    contact_force: np.ndarray | None = array("float64", "M 3", "[N] on the second body, world", optional=True)
    names: list[str] = field(default_factory=list)
    """Names of the bodies in pose, velocity and acceleration."""


@dataclass
class Imu(Message):
    """Carries inertial samples of a camera, in its own frame."""

    header: Header
    t: np.ndarray = array("int64", "n", "[ns]")
    acceleration: np.ndarray = array("float64", "n 3", "[m/s^2], gravity included")
    angular_velocity: np.ndarray = array("float64", "n 3", "[rad/s]")
    temperature: np.ndarray | None = array("float64", "n", "[deg C]", optional=True)


@dataclass
class Trigger(Message):
    """Carries external trigger edges."""

    header: Header
    t: np.ndarray = array("int64", "n", "[ns]")
    id: np.ndarray = array("uint8", "n", "channel")
    value: np.ndarray = array("uint8", "n", "1 = rising, 0 = falling")


@dataclass
class Image(Message):
    """Carries an image for people, or a frame of a real or simulated sensor, one environment's.

    `encoding` as in sensor_msgs/Image (rgb8, mono8, mono16 with a sensor's bits at the top). A frame's stamp is the
    middle of its exposure, from the first row's start to the last row's end; an image for people has no exposure.
    """

    header: Header
    data: np.ndarray = array("uint8|uint16|float32", "H W ?", "channels last, 1 or 3")
    encoding: str = "rgb8"
    exposure_ns: int = 0
    """How long each row was exposed."""
    line_delay_ns: int = 0
    """How much later a row is exposed than the one above it; 0 for a global shutter."""
    env: int = 0
    """Environment that it is of, of the `envs` that there are."""
    envs: int = 1

    @property
    def environment(self) -> tuple[int, int]:
        """Tells which environment it is of, and of how many."""
        return self.env, self.envs
