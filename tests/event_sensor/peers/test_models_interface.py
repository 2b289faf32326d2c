"""What all event models promise: order, seeds, batches, episodes, bad samples, parameters."""

import numpy as np
import pytest

import evis
from nodes.event_sensor.parameters import SENSOR, resolve_sensor
from nodes.event_sensor.peers import MODELS, make_model
from nodes.event_sensor.simulate import simulate_frames

MS = 1_000_000
NOISE = {
    "esim": {"threshold_mismatch": 0.03, "refractory_us": 300.0},
    "v2e": {"threshold_mismatch": 0.03, "refractory_us": 300.0, "leak_rate": 20.0, "leak_jitter": 0.1,
            "shot_rate": 50.0, "shot_white": 30.0, "bandwidth_hz": 100.0, "rate_spread_decades": 0.1},
    "dvs_voltmeter": {"shot_white": 30.0, "k3": 0.01, "k6": 0.005},
}  # fmt: skip
COLUMNS = ("t", "x", "y", "p")


def walk(envs, frames=17, height=6, width=9, seed=0):
    steps = np.random.default_rng(seed).normal(0, 0.3, (envs, frames, height, width))
    return np.exp(np.cumsum(steps, 1)).astype(np.float32)


@pytest.fixture(params=list(MODELS))
def name(request):
    return request.param


def test_events_are_sorted_and_within_the_call(name):
    images = walk(2)
    t = np.arange(17, dtype=np.int64) * MS + 5
    sensor = make_model(name, 6, 9, 2, seed=3, **NOISE[name])
    assert len(sensor.process(images[:, :1], t[:1], np.zeros(2)).t) == 0
    events = sensor.process(images[:, 1:], t[1:], np.zeros(2))
    env = np.repeat([0, 1], np.diff(events.env_offsets))
    assert (np.lexsort((events.x, events.y, events.t, env)) == np.arange(len(events.t))).all()
    assert events.t.min() > t[0] and events.t.max() <= t[-1] and (np.diff(events.env_offsets) > 100).all()
    assert [getattr(events, c).dtype for c in COLUMNS] == [np.int64, np.uint16, np.uint16, np.uint8]


def test_events_depend_neither_on_the_batch_nor_on_the_cut(name):
    """Environment e is a single camera with seed + e, and frames one by one give what they give together."""
    images = walk(3)
    t = np.arange(17, dtype=np.int64) * MS
    together = make_model(name, 6, 9, 3, seed=5, **NOISE[name]).process(images, t, np.zeros(3))
    for e in range(3):
        single = make_model(name, 6, 9, seed=5 + e, **NOISE[name])
        parts = [single.process(images[e : e + 1, k : k + 1], t[k : k + 1], np.zeros(1)) for k in range(17)]
        mine = slice(*together.env_offsets[e : e + 2])
        for column in COLUMNS:
            whole = getattr(together, column)[mine]
            assert np.concatenate([getattr(p, column) for p in parts]).tobytes() == whole.tobytes()


def test_the_seed_makes_the_noise(name):
    images, t = walk(1), np.arange(17, dtype=np.int64) * MS
    runs = [make_model(name, 6, 9, seed=s, **NOISE[name]).process(images, t, np.zeros(1)) for s in (1, 1, 2)]
    assert all(getattr(runs[0], c).tobytes() == getattr(runs[1], c).tobytes() for c in COLUMNS)
    assert runs[0].t.tobytes() != runs[2].t.tobytes()


def test_a_new_episode_fires_nothing_at_its_first_frame(name):
    """Environment 1 starts again on a picture 9 times as bright; environment 0 goes on in constant light."""
    quiet = {"dvs_voltmeter": {"k2": 0, "k3": 0, "k4": 0, "k5": 0, "k6": 0}}.get(name, {})
    sensor = make_model(name, 2, 3, 2, **quiet)
    ones = np.ones((2, 1, 2, 3), np.float32)
    sensor.process(ones, np.array([0]), np.array([0, 0]))
    bright = ones * np.array([1, 9], np.float32)[:, None, None, None]
    assert len(sensor.process(bright, np.array([MS]), np.array([0, 1])).t) == 0
    assert len(sensor.process(bright, np.array([2 * MS]), np.array([0, 1])).t) == 0
    assert np.diff(sensor.process(ones, np.array([3 * MS]), np.array([0, 1])).env_offsets).tolist()[0] == 0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0])
def test_a_bad_sample_is_counted_and_spoils_nothing(name, bad):
    images = walk(1)
    t = np.arange(17, dtype=np.int64) * MS
    good = make_model(name, 6, 9).process(images, t, np.zeros(1))
    spoilt = images.copy()
    spoilt[0, 8, 2, 3] = bad
    sensor = make_model(name, 6, 9)
    events = sensor.process(spoilt, t, np.zeros(1))
    assert sensor.counts() == {"nonfinite": 1}
    others = [(e.x != 3) | (e.y != 2) for e in (good, events)]
    late = [t_ & (e.t > t[9]) for t_, e in zip([~o for o in others], (good, events))]
    assert late[1].any()
    if name != "v2e":  # where one pixel decides about the stamps of all
        assert good.t[others[0]].tolist() == events.t[others[1]].tolist()


def test_no_event_is_lost_when_a_call_outgrows_its_buffer(name):
    """30 x 40 pixels over 60 thresholds and back: more than fit at first."""
    quiet = {"dvs_voltmeter": {"k1": 400.0, "k2": 0, "k3": 0, "k4": 0, "k5": 0, "k6": 0}}.get(name, {})
    images = np.ones((1, 3, 30, 40), np.float32)
    images[:, 1] = np.exp(12.1)
    sensor = make_model(name, 30, 40, threshold=0.2, **quiet)
    events = sensor.process(images, np.arange(3) * MS, np.zeros(1))
    counts = np.bincount(events.y.astype(int) * 40 + events.x, minlength=1200)
    assert counts.min() == counts.max() >= 2 * 59


def test_models_take_the_sensors_defaults_and_refuse_what_they_lack(name):
    given = resolve_sensor("event_sensor", "ideal", {"model": name})
    assert set(given) == set(SENSOR)
    make_model(name, 2, 2, **given)
    with pytest.raises(ValueError, match=f"event model {name} has no hot_pixel_rate, which is"):
        make_model(name, 2, 2, **{**given, "hot_pixel_rate": 3.0})
    with pytest.raises(ValueError, match="did you mean 'threshold_on'"):
        make_model(name, 2, 2, threshold_onn=0.1)
    with pytest.raises(ValueError, match=r"the least is 0\.001"):
        make_model(name, 2, 2, threshold=-0.1)


def test_a_models_own_parameters_reach_it_from_python_and_from_a_presets_file(tmp_path):
    """Without noise and leak, a rise from 100 to 103 DN is k1 x 3 / (101.5 + k2) of a threshold: 10.15 of k1 = 500."""
    frames, t = np.array([100, 103], np.float32).reshape(2, 1, 1), np.array([0, MS])
    own = {"k1": 500, "k2": 46.3, "k3": 0, "k4": 0, "k5": 0, "k6": 0}
    (path := tmp_path / "mine.yaml").write_text("".join(f"{k}: {v}\n" for k, v in own.items()))
    given = {"model": "dvs_voltmeter", "shot_white": 255}
    assert len(evis.EventSensor(1, 1, **given, **own)(frames, t)) == 10
    assert len(evis.EventSensor(1, 1, preset=path, **given)(frames, t)) == 10
    assert len(simulate_frames(frames, t, preset=str(path), **given)["t"]) == 10
    with pytest.raises(ValueError, match="no parameter 'k1'"):
        evis.EventSensor(1, 1, k1=500)
    with pytest.raises(ValueError, match=r"mine\.yaml has no parameter 'k1'"):
        evis.EventSensor(1, 1, preset=path, model="v2e")
    with pytest.raises(ValueError, match=r"preset is .*, must be a text"):
        evis.EventSensor(1, 1, preset={"k1": 500})


def test_misuse_has_one_clear_line(name):
    with pytest.raises(ValueError, match="must be one of esim, v2e, dvs_voltmeter"):
        make_model("iebcs", 2, 2)
    with pytest.raises(ValueError, match=f"event model {name} cannot have"):
        make_model(name, 0, 2)
    sensor = make_model(name, 2, 2)
    frame = np.ones((1, 1, 2, 2), np.float32)
    sensor.process(frame, np.array([5]), np.zeros(1))
    for bad, text in (
        ((frame, np.array([5]), np.zeros(1)), "do not ascend"),
        ((frame[:, :, :1], np.array([6]), np.zeros(1)), "expected"),
        ((frame, np.array([6]), np.zeros(2)), "expected"),
        ((frame, np.array([1 << 62]), np.zeros(1)), "too long"),
    ):
        with pytest.raises(ValueError, match=text):
            sensor.process(*bad)
