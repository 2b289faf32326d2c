"""Offers environments of Gymnasium on a Simulation; importing this registers evis/CartPole-v0, PanTilt-v0 and Pong-v0.

env = gymnasium.make("evis/CartPole-v0")                     # one environment
envs = gymnasium.make_vec("evis/CartPole-v0", num_envs=16)   # sixteen in one simulation
"""

try:
    import gymnasium
except ModuleNotFoundError as error:
    raise ModuleNotFoundError("evis.env needs Gymnasium: pip install 'evis[gym]'", name=error.name) from None

from evis.env.observation import Observation
from evis.env.observations import (
    CountImage,
    Frames,
    Joints,
    LastAction,
    Poses,
    RawEvents,
    TimeSurface,
    VoxelGrid,
)
from evis.env.single import EventEnv
from evis.env.state import State
from evis.env.task import Task
from evis.env.tasks import TASKS
from evis.env.vector import EventVectorEnv

__all__ = [
    "TASKS",
    "CountImage",
    "EventEnv",
    "EventVectorEnv",
    "Frames",
    "Joints",
    "LastAction",
    "Observation",
    "Poses",
    "RawEvents",
    "State",
    "Task",
    "TimeSurface",
    "VoxelGrid",
]

for _name in TASKS:
    gymnasium.register(
        f"evis/{_name}-v0",
        entry_point="evis.env.single:EventEnv",
        vector_entry_point="evis.env.vector:EventVectorEnv",
        kwargs={"task": _name},
    )
