"""A renderer node without a graph: who stands where the executor does, and states of a scene for it."""

import numpy as np

from evis.runtime.plan import Plan
from msgs.header import Header
from msgs.world import WorldState
from nodes.renderer.node import RendererNode

SIZE = {"width": 48, "height": 36}


class Bus:
    """Stands where the executor does, and keeps what is published."""

    plan = Plan("alone", "", "")

    def __init__(self, *wanted):
        self.wanted, self.sent, self.counts = set(wanted), [], {}

    def wants(self, node, port, array=""):
        return port in self.wanted

    def loan(self, node, port, arrays):
        return {name: np.empty(shape, dtype) for name, (shape, dtype) in arrays.items()}

    def publish(self, node, port, message):
        message.check()
        self.sent.append((port, message))

    def count(self, node, name, amount):
        self.counts[name] = self.counts.get(name, 0) + amount

    def take(self):
        sent, self.sent = dict(self.sent), []
        return sent


def start(*wanted, **params):
    node = RendererNode("renderer", {"scene": "spinning_disk", **SIZE, **params})
    node.runtime = Bus(*wanted)
    node.setup()
    return node, node.runtime


def state(scene, *milliseconds, episodes=(0,), stamp=0):
    """One instant for each environment."""
    pose = [[[b.trajectory.pose(np.array([int(ms * 1e6)]))[0] for b in scene.bodies]] for ms in milliseconds]
    pose = np.array(pose)
    names = [b.name for b in scene.bodies]
    header = Header(stamp, clock="sim", episode=max(episodes))
    twist = np.zeros((*pose.shape[:3], 6))
    return WorldState.dense(header, np.array([stamp]), pose, twist, np.array(episodes, np.int32), names=names)
