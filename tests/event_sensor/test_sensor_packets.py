"""Order and size of packets, environments, episodes, colour, defocus, misuse."""

import itertools

import numpy as np
import pytest
import warp as wp
from scipy.ndimage import gaussian_filter

from nodes.event_sensor.model.keys import KeyLayout
from nodes.event_sensor.optics.defocus import Defocus
from nodes.event_sensor.sensor import EventSensor
from nodes.event_sensor.simulate import simulate_frames

MS = 1_000_000
ONE = np.zeros(1, np.int32)


def walk(rng, *shape):
    return np.exp(np.cumsum(rng.normal(0, 0.4, shape), 0)).astype(np.float32)


@pytest.mark.parametrize("size", [(5, 7), (60, 90)])
def test_order_is_t_then_y_then_x(size):
    """Small packets and large ones are sorted by different code."""
    frames = walk(np.random.default_rng(0), 9, *size)
    frames[:, :, ::2] = frames[:, :1, :1]  # half of the pixels fire at the same times
    events = simulate_frames(frames, np.arange(9) * MS)
    order = np.lexsort((events["x"], events["y"], events["t"]))
    for name in ("t", "y", "x"):
        assert (events[name] == events[name][order]).all()
    assert len(set(events["t"].tolist())) < len(events["t"])
    assert len(events["t"]) > 8192 or size == (5, 7)


def test_no_event_is_lost_when_a_packet_outgrows_the_buffer():
    """40 x 50 pixels x 150 events, two orders above the first buffer; and the state is that of one pass."""
    frames = np.zeros((3, 40, 50), np.float32)
    frames[1] = 65504
    events = simulate_frames(frames, np.arange(3) * MS, threshold_on=0.15, threshold_off=0.15, dark_level=1e-5)
    counts = np.zeros((2, 40, 50), int)
    np.add.at(counts, (events["p"], events["y"], events["x"]), 1)
    assert (counts == 150).all()


def test_environments_are_those_of_single_runs():
    rng = np.random.default_rng(1)
    frames = walk(rng, 33, 4, 6, 9).transpose(1, 0, 2, 3)
    t = np.arange(33, dtype=np.int64) * MS
    together = EventSensor(6, 9, 4)
    alone = [EventSensor(6, 9) for _ in range(4)]
    for part in (slice(0, 1), slice(1, 9), slice(9, 33)):
        packet = together.process(frames[:, part], t[part], np.zeros(4, np.int32))
        assert packet.env_offsets[0] == 0 and packet.env_offsets[-1] == len(packet.t)
        for e in range(4):
            mine = slice(packet.env_offsets[e], packet.env_offsets[e + 1])
            single = alone[e].process(frames[e : e + 1, part], t[part], ONE)
            for name in ("t", "x", "y", "p"):
                assert getattr(packet, name)[mine].tobytes() == getattr(single, name).tobytes()
    assert len(packet.t) > 0


def test_a_new_episode_sets_the_reference_of_its_environment_only():
    frames = np.ones((2, 4, 2, 2), np.float32)
    sensor = EventSensor(2, 2, 2)
    t = np.arange(20, dtype=np.int64) * MS
    sensor.process(frames[:, :1], t[:1], np.array([0, 0]))
    changed = sensor.process(frames * 3, t[1:5], np.array([0, 1]))
    assert np.diff(changed.env_offsets).tolist() == [4 * 5, 0]
    after = sensor.process(frames * 9, t[5:9], np.array([0, 1]))
    # ln 9 and ln 3 above the two references: 10 - 5 thresholds still to come, and 5.
    assert np.diff(after.env_offsets).tolist() == [4 * 5, 4 * 5]


def test_all_environments_may_start_again_at_an_earlier_time():
    sensor = EventSensor(2, 2)
    sensor.process(np.ones((1, 2, 2, 2), np.float32), np.array([5 * MS, 6 * MS]), ONE)
    packet = sensor.process(np.full((1, 1, 2, 2), 9, np.float32), np.array([0]), ONE + 1)
    assert len(packet.t) == 0 and sensor.t_base == 0


def test_the_same_frames_give_the_same_bytes():
    frames = walk(np.random.default_rng(2), 20, 40, 50)
    runs = [simulate_frames(frames, np.arange(20) * MS) for _ in range(2)]
    assert all(runs[0][n].tobytes() == runs[1][n].tobytes() for n in ("t", "x", "y", "p"))


def test_colour_is_three_sensors():
    rng = np.random.default_rng(5)
    frames = walk(rng, 9, 6, 7, 3)
    t = np.arange(9, dtype=np.int64) * MS
    packet = EventSensor(6, 7, channels=3).process(frames[None], t, ONE)
    for c in range(3):
        single = simulate_frames(frames[..., c], t)
        for name in ("t", "x", "y", "p"):
            assert getattr(packet, name)[packet.c == c].tolist() == single[name].tolist()
    order = np.lexsort((packet.x, packet.y, packet.t))
    assert (np.diff(order) > 0).all()


@pytest.mark.parametrize("sigma", [0.3, 1.0, 2.5])
def test_defocus_is_a_gaussian_on_linear_intensity(sigma):
    images = np.exp(np.random.default_rng(6).uniform(-3, 3, (4, 21, 32, 1))).astype(np.float32)
    blurred = Defocus(sigma, "cpu")(wp.array(images, dtype=wp.float32, device="cpu")).numpy()
    radius = int(np.ceil(4 * sigma))
    for image, got in zip(images, blurred):
        want = gaussian_filter(image[..., 0].astype(np.float64), sigma, mode="nearest", radius=radius)
        np.testing.assert_allclose(got[..., 0], want, rtol=2e-6)


def test_defocus_spreads_the_events_of_a_point():
    frames = np.ones((2, 15, 15), np.float32)
    frames[1, 7, 7] = 300
    t = np.arange(2) * MS
    sharp, soft = (simulate_frames(frames, t, defocus_px=d) for d in (0.0, 1.0))
    assert set(zip(sharp["x"].tolist(), sharp["y"].tolist())) == {(7, 7)}
    want = gaussian_filter(frames[1].astype(np.float64), 1.0, mode="nearest", radius=4)
    counts = np.zeros((15, 15), int)
    np.add.at(counts, (soft["y"], soft["x"]), 1)
    assert (counts == np.floor(np.log(want) / 0.2 + 1e-6)).all()


def test_colour_and_defocus_go_together():
    frames = walk(np.random.default_rng(7), 5, 8, 9, 3)
    t = np.arange(5, dtype=np.int64) * MS
    packet = EventSensor(8, 9, channels=3, defocus_px=0.8).process(frames[None], t, ONE)
    for c in range(3):
        single = simulate_frames(frames[..., c], t, defocus_px=0.8)
        assert packet.t[packet.c == c].tolist() == single["t"].tolist()


def test_key_fields_do_not_overlap():
    for height, width, envs in ((1, 1, 1), (260, 346, 1), (720, 1280, 64), (65536, 65536, 1), (128, 128, 65536)):
        layout = KeyLayout.of(height, width, envs)
        assert 1 << (layout.y - layout.x) >= width and 1 << (layout.t - layout.y) >= height
        assert 1 << (63 - layout.env) >= envs and layout.env - layout.t >= 28


def test_misuse_has_one_clear_line():
    with pytest.raises(ValueError, match=r"threshold_on is 0\.0 ln I, the least is 0\.001 ln I"):
        EventSensor(2, 2, threshold_on=0)
    with pytest.raises(ValueError, match="too many for one event sensor"):
        EventSensor(65536, 65536, 1 << 20)
    with pytest.raises(ValueError, match="dark_level is nan; it must be finite"):
        EventSensor(2, 2, dark_level=float("nan"))
    with pytest.raises(ValueError, match="no device 'gpu' here; there is cpu"):
        EventSensor(2, 2, device="gpu")
    sensor = EventSensor(2, 2)
    frame = np.ones((1, 1, 2, 2), np.float32)
    sensor.process(frame, np.array([5]), ONE)
    for bad, text in (
        ((frame, np.array([5]), ONE), "after one at 5 ns of the episode"),
        ((frame, np.array([1 << 60]), ONE), "too long for the event sensor"),
        ((frame[:, :, :1], np.array([6]), ONE), r"expected \(1, 1, 2, 2\)"),
        ((np.ones((1, 2, 2, 2), np.float32), np.array([7, 6]), ONE), "do not ascend"),
        ((frame, np.array([6]), np.zeros(2)), "episodes of shape"),
    ):
        with pytest.raises(ValueError, match=text):
            sensor.process(*bad)
    for shape, t in (((3, 4), np.arange(3)), ((3, 4, 5), np.arange(4)), ((0, 4, 5), np.arange(0))):
        with pytest.raises(ValueError, match="frames must be luminance"):
            simulate_frames(np.ones(shape), t)
    with pytest.raises(ValueError, match="whole nanoseconds"):
        simulate_frames(np.ones((3, 4, 5)), np.arange(3) * 0.1)


@pytest.mark.parametrize("fault", [{"readout_rate": 3000.0}, {"timestamp_jitter_us": 300.0}])
@pytest.mark.parametrize("crossing", ["linear", "monotone", "cubic"])
def test_a_reset_cuts_what_waits_at_the_readout_whatever_the_packet(fault, crossing):
    frames = walk(np.random.default_rng(3), 40, 2, 8, 10).swapaxes(0, 1)
    t = np.arange(40, dtype=np.int64) * 1_641_105

    def run(size):
        sensor = EventSensor(8, 10, 2, threshold=0.15, crossing=crossing, seed=4, **fault)
        cuts = sorted({*range(0, 40, size), 20, 40})
        parts = []
        for a, b in itertools.pairwise(cuts):
            parts.append(sensor.process(np.ascontiguousarray(frames[:, a:b]), t[a:b], np.array([0, a >= 20])))
        parts.append(sensor.flush())
        envs = [[np.concatenate([getattr(e, n)[slice(*e.env_offsets[i : i + 2])] for e in parts]) for n in "txyp"]
                for i in range(2)]  # fmt: skip
        return envs, sensor.counts()

    (alone, counts), (together, counts_together) = run(1), run(5)
    assert counts == counts_together and counts["readout_cut"] > 0
    for one, many in zip(alone, together):
        assert all(np.array_equal(a, b) for a, b in zip(one, many))
    assert not ((together[1][0] > t[19]) & (together[1][0] <= t[20])).any()


def test_an_error_leaves_the_sensor_usable():
    sensor = EventSensor(2, 2)
    sensor.process(np.ones((1, 1, 2, 2), np.float32), np.array([5]), ONE)
    with pytest.raises(ValueError):
        sensor.process(np.full((1, 1, 2, 2), 9, np.float32), np.array([1 << 60]), ONE)
    packet = sensor.process(np.full((1, 1, 2, 2), 1.5, np.float32), np.array([MS]), ONE)
    assert len(packet.t) == 4 * 2


@pytest.mark.gpu
@pytest.mark.parametrize("channels", [1, 3])
def test_gpu_gives_the_events_of_the_cpu(channels):
    rng = np.random.default_rng(8)
    frames = walk(rng, 33, 3, 40, 50, *((3,) if channels == 3 else ())).swapaxes(0, 1)
    frames = np.ascontiguousarray(frames)
    t = np.arange(33, dtype=np.int64) * MS
    cpu, gpu, again = (
        EventSensor(40, 50, 3, channels=channels, defocus_px=0.7, device=d).process(frames, t, np.zeros(3, np.int32))
        for d in ("cpu", "cuda", "cuda")
    )
    assert all(getattr(gpu, n).tobytes() == getattr(again, n).tobytes() for n in ("t", "x", "y", "p"))
    assert np.abs(np.diff(cpu.env_offsets) - np.diff(gpu.env_offsets)).max() <= 2
    histogram = lambda e: np.histogramdd(np.stack([e.t, e.y, e.x], 1), (33, 40, 50), ((0, 33 * MS), (0, 40), (0, 50)))[
        0
    ]
    # The blur is summed in another order and rounded elsewhere: a crossing in a thousand may move over a bin's edge.
    assert np.abs(histogram(cpu) - histogram(gpu)).sum() <= 2e-3 * len(cpu.t)
