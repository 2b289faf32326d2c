"""A physics node by itself, and what stands for the executor beside it."""

import numpy as np

from evis.runtime.plan import Plan
from nodes.physics.node import PhysicsNode


class Wire:
    """Stands for the executor: keeps what the node publishes, counts and says."""

    def __init__(self):
        self.messages, self.counts, self.warnings = [], {}, []
        self.plan = Plan("", "", "")

    def wants(self, node, port, array=""):
        return True

    def loan(self, node, port, arrays):
        return {name: np.empty(shape, dtype) for name, (shape, dtype) in arrays.items()}

    def publish(self, node, port, message):
        message.check()
        self.messages.append(message)

    def count(self, node, name, amount):
        self.counts[name] = self.counts.get(name, 0) + amount

    def diagnose(self, node, level, text):
        self.warnings.append(text)


def node_of(**params):
    node = PhysicsNode("physics", params)
    node.runtime = Wire()
    node.setup()
    return node
