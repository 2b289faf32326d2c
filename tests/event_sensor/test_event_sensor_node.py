"""The node: frames or keyframes in, one packet per message out."""

import numpy as np
import pytest

from evis.config.params import EACH, ParamError
from msgs.camera import Frames, Keyframe
from msgs.header import Header
from nodes.event_sensor.node import EventSensorNode
from nodes.event_sensor.presets import PRESETS
from nodes.event_sensor.simulate import simulate_frames

MS = 1_000_000


class Bus:
    """Stands for the executor."""

    def __init__(self, wanted):
        self.sent, self.counted, self.warned, self.wanted = [], {}, [], wanted

    def wants(self, node, port):
        return port in self.wanted

    def loan(self, node, port, arrays):
        return {name: np.zeros(shape, dtype) for name, (shape, dtype) in arrays.items()}

    def publish(self, node, port, message):
        message.check()
        self.sent.append(message)

    def count(self, node, name, amount):
        self.counted[name] = self.counted.get(name, 0) + amount

    def diagnose(self, node, level, text):
        self.warned.append((level, text))


def start(wanted=("events",), **params):
    node = EventSensorNode("event_sensor", params)
    node.runtime = Bus(wanted)
    node.setup()
    return node


def frames(t, luminance, **more):
    header = Header(int(t[-1]), clock="sim", episode=3)
    return Frames(header, np.asarray(t, np.int64), np.full(1, 3, np.int32), luminance[None], **more)


@pytest.fixture
def video():
    return np.exp(np.cumsum(np.random.default_rng(0).normal(0, 0.3, (17, 6, 8)), 0)).astype(np.float32)


def test_one_packet_per_message_the_first_is_empty(video):
    node = start(threshold=0.15)
    t = np.arange(17, dtype=np.int64) * MS + 5
    for part in (slice(0, 1), slice(1, 9), slice(9, 17)):
        node.update({"frames": frames(t[part], video[part])})
    packets = node.runtime.sent
    assert [len(p.t) > 0 for p in packets] == [False, True, True]
    assert [p.t0_ns for p in packets] == [5, 5, 8 * MS + 5]
    assert [(p.header.stamp_ns, p.header.episode, p.width, p.height) for p in packets][1] == (8 * MS + 5, 3, 8, 6)
    whole = simulate_frames(video, t, threshold=0.15)
    assert np.concatenate([p.t for p in packets]).tolist() == whole["t"].tolist()


def test_what_is_signal_goes_out_beside_the_events(video):
    """With each packet, of its stamp and length, and the events are those of who does not ask."""
    both, alone = start(("events", "signal"), shot_rate=2000.0, seed=4), start(shot_rate=2000.0, seed=4)
    t = np.arange(17, dtype=np.int64) * MS
    for part in (slice(0, 1), slice(1, 9), slice(9, 17)):
        for node in (both, alone):
            node.update({"frames": frames(t[part], video[part])})
    packets, signals = both.runtime.sent[::2], both.runtime.sent[1::2]
    assert [(p.header.stamp_ns, p.header.episode) for p in packets] == [
        (s.header.stamp_ns, s.header.episode) for s in signals
    ]
    assert all(
        np.array_equal(p.env_offsets, s.env_offsets) and len(p.t) == len(s.signal) for p, s in zip(packets, signals)
    )
    assert [p.t.tolist() for p in packets] == [p.t.tolist() for p in alone.runtime.sent]
    assert 0 < np.concatenate([s.signal for s in signals]).mean() < 1
    with pytest.raises(ValueError, match="event model v2e does not say which events noise made"):
        start(("events", "signal"), model="v2e")
    each = [{"photoreceptor_noise": noise, "bandwidth_hz": 60.0, "seed": 1} for noise in (0.0, 0.1)]
    with pytest.raises(ValueError, match=r"light and noise make each crossing together, .*leave out labels:=events"):
        start(("events", "signal"), envs=2, **{EACH: each})


def test_the_rate_of_events_in_light_that_swings_is_that_of_the_closed_form():
    """L = s + A (sin(2 pi f t + phi) - sin phi): floor((A - d) / C) + floor((A + d) / C) ON a period, d = A sin phi.

    For 2 s of frames at 2 kHz, eight a message; amplitudes of which no level lies within 0.004 of an extremum, where
    straight lines between frames may pass it by. What a period begins with at 0 it ends with: one event at the most.
    """
    rng, c, seconds = np.random.default_rng(2), 0.2, 2
    a, phi, f = rng.uniform(0.25, 1.25, 400), rng.uniform(0, 2 * np.pi, 400), rng.integers(1, 21, 400)
    reach = (a * (1 + np.outer([-1, 1], np.sin(phi)))) / c
    clear = ((reach % 1 > 0.02) & (reach % 1 < 0.98)).all(0)
    a, phi, f, reach = a[clear], phi[clear], f[clear], np.floor(reach[:, clear]).sum(0)
    t = np.arange(2000 * seconds + 1, dtype=np.int64) * 500_000
    light = np.exp(a * np.sin(2 * np.pi * f * t[:, None] * 1e-9 + phi)).astype(np.float32)[:, None, :]
    node = start(threshold=c)
    node.update({"frames": frames(t[:1], light[:1])})
    for k in range(1, len(t), 8):
        node.update({"frames": frames(t[k : k + 8], light[k : k + 8])})
    packets = node.runtime.sent[1:]
    assert all(((p.t > p.t0_ns) & (p.t <= p.header.stamp_ns)).all() for p in packets)
    for on in (0, 1):
        counts = sum(np.bincount(p.x[p.p == on], minlength=len(a)) for p in packets)
        assert np.abs(counts - seconds * f * reach).max() <= 1
    per_second = sum(len(p.t) for p in packets) / seconds
    assert abs(per_second - 2 * (f * reach).sum()) < 0.5 * len(a) and len(a) > 300


def test_keyframes_go_straight_in_where_there_is_no_interpolator(video):
    node = start(source="keyframe", threshold_on=0.2, threshold_off=0.3)
    assert EventSensorNode.needs(node.params, frozenset({"events"})) == {"keyframe"}
    t = np.arange(17, dtype=np.int64) * MS
    for k in range(17):
        radiance = np.full((1, 10, 12, 3), 1e4, np.float32)
        radiance[0, 2:-2, 2:-2] = video[k][..., None]
        key = Keyframe(Header(int(t[k])), np.zeros(1, np.int32), radiance, margin=2)
        node.update({"keyframe": key})
    whole = simulate_frames(video, t, threshold_on=0.2, threshold_off=0.3)
    got = np.concatenate([p.t for p in node.runtime.sent])
    # The weights of R, G and B add up to 1 within one rounding of float32.
    assert len(got) == len(whole["t"]) and np.abs(got - whole["t"]).max() < 2000


def test_colour_packets_have_a_channel(video):
    node = start(colour=True)
    rgb = np.stack([video, np.ones_like(video), video[::-1]], -1)
    t = np.arange(17, dtype=np.int64) * MS
    node.update({"frames": Frames(Header(0), t[:1], np.zeros(1, np.int32), rgb=rgb[None, :1])})
    node.update({"frames": Frames(Header(int(t[-1])), t[1:], np.zeros(1, np.int32), rgb=rgb[None, 1:])})
    packet = node.runtime.sent[-1]
    assert set(packet.c.tolist()) == {0, 2}
    assert packet.t[packet.c == 0].tolist() == simulate_frames(video, t)["t"].tolist()


def test_colour_set_on_one_side_only_is_named(video):
    with pytest.raises(ValueError, match="frames carry luminance, the sensor needs rgb; set colour alike"):
        start(colour=True).update({"frames": frames(np.array([0]), video[:1])})


def test_what_was_bad_is_counted_once(video):
    node = start()
    video[3, 2, 2] = np.nan
    video[12, 2, 2] = -1
    t = np.arange(17, dtype=np.int64) * MS
    for part in (slice(0, 1), slice(1, 9), slice(9, 17)):
        node.update({"frames": frames(t[part], video[part])})
    assert node.runtime.counted == {"nonfinite_samples": 2}
    assert len(node.runtime.warned) == 1 and "1 samples at 8000000 ns" in node.runtime.warned[0][1]


@pytest.mark.parametrize("dark_level", [0.0, 0.1])
def test_black_frames_are_said_once_and_not_with_a_dark_level(video, dark_level):
    node = start(dark_level=dark_level)
    for k in range(3):
        node.update({"frames": frames(np.array([k * MS]), 0 * video[k : k + 1])})
    said = [text for level, text in node.runtime.warned if level == "warning" and "black (ln 0;" in text]
    assert len(said) == len(node.runtime.warned) == (0 if dark_level else 1)
    assert node.runtime.counted == ({} if dark_level else {"nonfinite_samples": 3 * 48})


@pytest.mark.parametrize("crossing", ["cubic", "monotone"])
def test_look_ahead_holds_one_step_back_and_finish_brings_it(video, crossing):
    node = start(crossing=crossing, threshold=0.15)
    t = np.arange(17, dtype=np.int64) * MS + 5
    for part in (slice(0, 1), slice(1, 9), slice(9, 17)):
        node.update({"frames": frames(t[part], video[part])})
    node.finish()
    packets = node.runtime.sent
    assert [p.header.stamp_ns for p in packets] == [5, 8 * MS + 5, 16 * MS + 5, 16 * MS + 5]
    assert [p.t0_ns for p in packets] == [5, 5, 7 * MS + 5, 15 * MS + 5]
    ends = [5, 7 * MS + 5, 15 * MS + 5, 16 * MS + 5]
    assert all(((p.t > p.t0_ns) & (p.t <= end)).all() for p, end in zip(packets, ends))
    whole = simulate_frames(video, t, threshold=0.15, crossing=crossing)
    assert np.concatenate([p.t for p in packets]).tolist() == whole["t"].tolist()
    assert len(packets[3].t) > 0


def test_known_slopes_are_for_frames_from_a_file_alone():
    """ln I = sin(2 pi 60 Hz t + phase): a curve, with which slopes that belong to it move the times."""
    t = np.arange(17, dtype=np.int64) * MS
    angle = 2 * np.pi * 60 * 1e-9 * t[:, None, None] + np.linspace(0, 6, 48).reshape(6, 8)
    video, slopes = (a.astype(np.float32) for a in (np.exp(np.sin(angle)), 2 * np.pi * 60 * np.cos(angle)))
    whole = simulate_frames(video, t, slopes, crossing="hermite")
    assert whole["t"].tolist() != simulate_frames(video, t)["t"].tolist()
    with pytest.raises(ValueError, match="must be one of frame, linear, monotone, cubic"):
        start(crossing="hermite")


@pytest.mark.parametrize("name", ["esim", "v2e", "evis-paper"])
def test_other_models_are_one_parameter_away(video, name):
    node = start(model=name)
    t = np.arange(17, dtype=np.int64) * MS
    for part in (slice(0, 1), slice(1, 17)):
        node.update({"frames": frames(t[part], video[part])})
    node.finish()
    whole = simulate_frames(video, t, model=name)
    assert np.concatenate([p.t for p in node.runtime.sent]).tolist() == whole["t"].tolist()
    assert len(whole["t"]) > 100


def test_a_parameter_wins_over_the_preset():
    name = next(n for n, preset in PRESETS.items() if "threshold_on" in preset.values or "threshold" in preset.values)
    assert start(preset=name)._resolved != start(preset="ideal")._resolved
    assert start(preset=name, threshold_on=0.123)._resolved["threshold_on"] == 0.123


def test_parameters_name_the_nearest_valid_one():
    with pytest.raises(ParamError, match="did you mean 'threshold_on'"):
        EventSensorNode("event_sensor", {"threshold_onn": 1})
    with pytest.raises(ParamError, match="the least is"):
        EventSensorNode("event_sensor", {"threshold": 0})
