"""Runs the inertial unit as a node: states in, inertial samples of a camera out."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from evis.config.params import Param
from evis.config.suggestions import nearest
from evis.runtime.node import Input, Node, Output
from msgs.camera import Imu
from msgs.header import Header, Message
from msgs.own_time import CONFIGURED, NUMBER, ORIGIN, SEED
from msgs.world import WorldState

if TYPE_CHECKING:
    from nodes.imu.inertial import ImuModel, InertialUnit

LARGEST = 1e6
RANDOM = {
    "accel_noise": "noise of the accelerometer",
    "gyro_noise": "noise of the gyroscope",
    "accel_bias": "bias of the accelerometer",
    "gyro_bias": "bias of the gyroscope",
}
"""Parameters -> what they turn on that is random."""


class ImuNode(Node):
    """Publishes what an accelerometer and a gyroscope at a camera read, in its axes (x right, y down, z forward)."""

    PARAMS: ClassVar[Mapping[str, Param]] = {
        "camera": Param(str, "cam0", "camera that carries the unit"),
        "rate": Param(float, 1000.0, "samples per second", "Hz", 0.001, LARGEST),
        "gravity": Param(
            float, 9.81, "where no model moves bodies and has its own, along the world's -z", "m/s^2", 0, LARGEST
        ),
        "accel_noise": Param(
            float, 0.0, "white noise of the accelerometer (consumer MEMS: 0.002)", "m/s^2/sqrt(Hz)", 0, LARGEST
        ),
        "gyro_noise": Param(
            float, 0.0, "white noise of the gyroscope (consumer MEMS: 0.0002)", "rad/s/sqrt(Hz)", 0, LARGEST
        ),
        "accel_bias": Param(float, 0.0, "random walk of the accelerometer's bias", "m/s^3/sqrt(Hz)", 0, LARGEST),
        "gyro_bias": Param(float, 0.0, "random walk of the gyroscope's bias", "rad/s^2/sqrt(Hz)", 0, LARGEST),
        "accel_range": Param(float, 0.0, "largest acceleration it can read, 0 = any", "m/s^2", 0, LARGEST),
        "gyro_range": Param(float, 0.0, "largest angular velocity it can read, 0 = any", "rad/s", 0, LARGEST),
        "seed": Param(int, 0, "seed of noise and bias", "", 0, 2**63 - 1),
    }
    INPUTS: ClassVar[Mapping[str, Input]] = {"state": Input("/state")}
    OUTPUTS: ClassVar[Mapping[str, Output]] = {"imu": Output("/{camera}/imu")}

    @classmethod
    def random(cls, params: Mapping[str, Any]) -> tuple[str, ...]:
        """Names the noise and bias that the parameters ask for, which the seed decides."""
        return tuple(what for name, what in RANDOM.items() if params[name])

    def setup(self) -> None:
        """Makes the inertial unit from the parameters."""
        from nodes.imu.inertial import ImuModel

        self._model: ImuModel = ImuModel(**{field.name: self.params[field.name] for field in fields(ImuModel)})
        self._unit: InertialUnit = self._made(self._model.seed)
        self._begun: tuple[int, int] | None = None
        """Origin of the camera's own time [ns] and its seed, once it was reset."""

    def rewind(self, params: Mapping[str, Any]) -> bool:
        """Makes the unit anew."""
        self.params = dict(params)
        self.setup()
        return True

    def state(self) -> tuple[Any, ...]:
        """Gives the unit, with its biases and the last velocities, and since when its time counts."""
        return copy.deepcopy(self._unit), self._begun

    def restore(self, state: tuple[Any, ...]) -> None:
        """Goes on with this unit."""
        self._unit, self._begun = copy.deepcopy(state)

    def update(self, inputs: Mapping[str, Message]) -> None:
        """Publishes the samples of one interval; none at an episode's first stamp."""
        state = inputs["state"]
        assert isinstance(state, WorldState)
        body = self._body(state)
        pose, twist = state.rows([body])
        t, number, origin = state.t, int(state.episodes[0]), 0
        if state.own is not None and state.own_t is not None:
            t, number, origin = state.own_t[0], int(state.own[0, NUMBER]), int(state.own[0, ORIGIN])
            self._begin(origin, int(state.own[0, SEED]))
        gravity = None if state.gravity is None else np.asarray(state.gravity)[0]
        read = self._unit.advance(t, pose[0, :, 0], twist[0, :, 0], number, gravity)
        self.count_total("clipped_samples", self._unit.clipped)
        self.count_total("nonfinite_samples", self._unit.nonfinite)
        header = Header(state.header.stamp_ns, clock=state.header.clock, episode=state.header.episode)
        self.publish("imu", Imu(header, read.t + origin, read.acceleration, read.angular_velocity))

    def _begin(self, origin: int, seed: int) -> None:
        """Takes a unit whose time begins with a reset."""
        if self._begun != (origin, seed):
            self._begun = origin, seed
            self._unit = self._made(self._model.seed if seed == CONFIGURED else seed)
            self.restart_totals()

    def _made(self, seed: int) -> InertialUnit:
        """Makes the unit of a run with a seed."""
        from evis.random_numbers import seed_of_camera
        from nodes.imu.inertial import InertialUnit

        return InertialUnit(replace(self._model, seed=seed_of_camera(seed, self.below(self.params["camera"]))))

    def _body(self, state: WorldState) -> int:
        """Index of the camera in the state. Raises ValueError for several environments and for an unknown camera."""
        envs = len(state.end_pose)
        if envs != 1:
            raise ValueError(
                f"{self.name}: an Imu message holds one camera, /state has {envs} environments; run with envs 1, or "
                "without imu"
            )
        camera = self.params["camera"]
        if camera not in state.names:
            raise ValueError(f"{self.name}: /state has no body '{camera}'; {nearest(camera, state.names)}")
        return state.names.index(camera)
