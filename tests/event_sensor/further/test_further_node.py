"""The node on /<cam>/samples: what it reads, the packets it makes, environments that begin anew by themselves."""

import numpy as np
import pytest
from further_rig import Gap, random_gaps, sensed, tell

from evis.bag.environments import join, split
from msgs.camera import Frames, Samples
from msgs.header import Header
from msgs.own_time import CONFIGURED
from nodes.event_sensor.input.further import Further
from nodes.event_sensor.node import EventSensorNode


class Bus:
    """Stands for the executor."""

    def __init__(self):
        self.sent = []

    def wants(self, node, port):
        return port == "events"

    def loan(self, node, port, arrays):
        return {name: np.zeros(shape, dtype) for name, (shape, dtype) in arrays.items()}

    def publish(self, node, port, message):
        message.check()
        self.sent.append(message)

    def count(self, node, name, amount): ...

    def diagnose(self, node, level, text): ...


def start(**params) -> EventSensorNode:
    node = EventSensorNode("event_sensor", {"source": "samples", **params})
    node.runtime = Bus()
    node.setup()
    return node


def message(gap: Gap, **more) -> Samples:
    """The message of a gap; colour by the frames' shape."""
    header, episodes = Header(int(gap.t[-1])), np.zeros(len(gap.frames), np.int32)
    names = ("luminance", "further") if gap.frames.ndim == 4 else ("rgb", "further_rgb")
    values = dict(zip(names, (gap.frames, gap.further.value)))
    made = Samples(header, gap.t, episodes, gap.further.first, gap.further.offset, **{**values, **more})
    made.check()
    return made


@pytest.mark.parametrize(
    "params",
    [
        {},
        {"shot_rate": 30.0, "refractory_us": 200.0, "seed": 3},
        {"bandwidth_hz": 300.0},
        {"colour": True},
        {"bandwidth_hz": 30.0, "bandwidth_poles": 2, "photoreceptor_noise": 0.1, "seed": 4},
        # So slow that the step by which its kernels are compiled would be longer than a message may be.
        {"bandwidth_hz": 0.25, "photoreceptor_noise": 0.1, "threshold": 0.001, "threshold_floor": 0.001},
    ],
)
def test_packets_are_those_of_the_sensor(params):
    shape = (2, 3, 4, 3) if "colour" in params else (2, 3, 4)
    gaps = random_gaps(np.random.default_rng(1), shape, 3, 4, 8.0)
    node = start(**params)
    node.warm_up()
    assert EventSensorNode.needs(node.params, frozenset({"events"})) == {"samples"}
    for gap in gaps:
        node.update({"samples": message(gap)})
    packets = node.runtime.sent
    assert [(p.t0_ns, p.header.stamp_ns) for p in packets] == [(g.start, int(g.t[-1])) for g in gaps]
    found = []
    for packet in packets:
        packet.signal = None
        found += tell(packet)
    assert len(found) > 300 and found == sensed(gaps, **{k: v for k, v in params.items() if k != "colour"})[0]


@pytest.mark.parametrize(
    "params", [{"defocus_px": 0.7}, {"crossing": "cubic"}, {"model": "v2e"}, {"model": "evis-paper"}]
)
def test_sensors_that_take_frames_alone_read_frames(params):
    node = start(**params)
    assert EventSensorNode.needs(node.params, frozenset({"events"})) == {"frames"}
    for gap in random_gaps(np.random.default_rng(1), (1, 3, 4), 2, 4, 0.0, bad=0.0):
        episodes = np.zeros(1, np.int32)
        node.update({"frames": Frames(Header(int(gap.t[-1])), gap.t, episodes, luminance=gap.frames)})
    assert len(node.runtime.sent) == 3 and len(node.runtime.sent[-1].t)


def test_environments_that_were_reset_by_themselves():
    """Environment 1 begins anew at the third message; each has the events of a sensor of its own, at its own times."""
    gaps = random_gaps(np.random.default_rng(4), (2, 3, 4), 4, 4, 8.0, bad=0.0)
    reset = int(gaps[2].t[-1])
    node = start(threshold=0.3)
    for k, gap in enumerate(gaps):
        own, own_t = np.zeros((2, 4), np.int64), np.stack([gap.t, gap.t])
        own[:, 0], own[:, 2] = int(gap.t[-1]), CONFIGURED
        whole, further = gap.frames.copy(), gap.further
        if k >= 2:
            own[1] = [int(gap.t[-1]) - reset, reset, 7, 1]
            own_t[1] -= reset
        if k == 2:
            # In the gap in which it begins, the keyframe stands in all of its frames, and nothing between.
            whole[1], own_t[1] = whole[1, -1:], 0
            alone = further.of(slice(0, 1), 2)
            first = np.concatenate([alone.first, np.full(12, alone.first[-1], np.int32)])
            further = Further(first, alone.offset, alone.value)
        more = {"own": own, "own_t": own_t} if k >= 2 else {}
        made = message(Gap(gap.start, gap.t, whole, further), **more)
        made.episodes = np.array([0, int(k >= 2)], np.int32)
        assert all(np.array_equal(a, made.arrays()[n]) for n, a in join(split(made, 2)).arrays().items())
        node.update({"samples": made})
    found = [event for packet in node.runtime.sent for event in tell_plain(packet)]
    for env, mine in ((0, gaps), (1, gaps[:2]), (1, gaps[3:])):
        alone = [Gap(g.start, g.t, g.frames[env : env + 1], g.further.of(slice(env, env + 1), 2)) for g in mine]
        if env == 1 and mine[0] is gaps[3]:
            last = Gap(reset, np.array([reset]), gaps[2].frames[1:, -1:], alone[0].further.none())
            alone = [last, *alone]
        expected = sensed(alone, threshold=0.3)[0]
        times = {int(t) for g in mine for t in (g.start, g.t[-1])}
        here = [e[1:] for e in found if e[0] == env and min(times) < e[1] <= max(times)]
        assert len(here) > 100 and sorted(here) == sorted(e[1:] for e in expected)


def tell_plain(packet):
    packet.signal = None
    return tell(packet)


def test_values_that_lack_are_told():
    gap = random_gaps(np.random.default_rng(1), (1, 3, 4), 1, 2)[1]
    node = start(colour=True)
    made = message(gap)
    made.rgb = np.repeat(made.luminance[..., None], 3, -1)
    with pytest.raises(ValueError, match="samples lack the values between the frames; set colour alike"):
        node.update({"samples": made})
