"""Recorder and replayer without an executor: a test calls their methods, and reads what they publish."""

from collections import defaultdict

from evis.runtime.plan import NodePlan, Plan


class Runtime:
    """Stands for the executor. Sequence numbers are counted per topic, as on the bus."""

    def __init__(self):
        self.plan = Plan("disk", "run-1", "/nowhere", seed=5, launch_text="nodes: {}\n")
        self.plan.nodes["physics"] = NodePlan("physics", "x:Y", {"omega": 60.0}, "physics")
        self.plan.topics = dict.fromkeys(["/cam0/keyframe", "/cam0/events"])  # what is published in the graph
        self.counters = defaultdict(float)
        self.results = {}
        self.said = []
        self.published = []
        self.sequence = defaultdict(int)

    def wants(self, node, port):
        return True

    def count(self, node, name, amount):
        self.counters[name] += amount

    def result(self, node, name, value):
        self.results[name] = value

    def diagnose(self, node, level, text):
        self.said.append((level, text))

    def publish(self, node, port, message):
        message.header.seq = self.sequence[port]
        self.sequence[port] += 1
        self.published.append((port, message))


def make_node(kind, **params):
    """Makes a node of a class; its name is the class's."""
    node = kind(kind.__name__, params)
    node.runtime = Runtime()
    return node
