"""Which action counts at a stamp: the last one that answers it, and at a lower rate after a divergence too."""

import textwrap

import pytest

import evis
from evis.bus.memory.slots import MOST_SLOTS

CONTROLLER = """
from evis.runtime.node import Input, Node, Output
from msgs.header import Header
from msgs.world import Action


class Loaning(Node):
    INPUTS = {"state": Input("/state")}
    OUTPUTS = {"action": Output("/action")}

    def update(self, inputs):
        state = inputs["state"]
        controls = self.loan("action", controls=((len(state.episodes), 1), "float64"))["controls"]
        controls[...] = 0.1
        self.publish("action", Action(Header(state.header.stamp_ns, episode=state.header.episode), controls))
"""

GRAPH = """
nodes:
  physics: {type: physics, keep: [state], params: {scene: cart_pole, keyframe_rate: 50, envs: 2}}
  controller: {type: "loaning:Loaning"}
"""

SLOW = """
nodes:
  physics:
    type: physics
    keep: [state]
    params: {scene: cart_pole, keyframe_rate: 50, action_rate: 25, speed_limit: 2.0}
"""


def test_an_action_that_a_later_one_replaces_gives_its_memory_back(tmp_path):
    """A reset shows the controller the state of the same stamp once more, which it answers once more."""
    (tmp_path / "loaning.py").write_text(textwrap.dedent(CONTROLLER))
    (tmp_path / "loaning.yaml").write_text(GRAPH)
    with evis.Simulation(str(tmp_path / "loaning.yaml"), outputs=["state"]) as sim:
        sim.reset()
        for _ in range(MOST_SLOTS + 2):
            sim.step()
            sim.reset(envs=[0])


def test_after_a_divergence_actions_are_due_when_physics_takes_them(tmp_path):
    """It diverges at an odd keyframe, from which those of half the rate are counted on."""
    (tmp_path / "slow.yaml").write_text(SLOW)
    with evis.Simulation(str(tmp_path / "slow.yaml"), outputs=["state"]) as sim:
        sim.reset()
        push = [sim.actuators[0].high]
        with pytest.raises(evis.Diverged):
            for k in range(100):
                sim.step(push if k % 2 == 0 else None)
        assert k % 2 == 0, "the keyframe of the divergence is k + 1"
        still = sim.step([0.0])
        with pytest.raises(evis.SimulationError, match="an action is due at every 2"):
            sim.step(push)
        assert still.stamp_ns == sim.stamp_ns
        sim.step()
        sim.step(push)
