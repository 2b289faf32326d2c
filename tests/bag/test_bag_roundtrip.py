"""Every message type through a bag and back, bit by bit."""

import dataclasses
import math
import tempfile
from pathlib import Path

import numpy as np
import pytest
from bag_messages import copied, same, scene
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from mcap.reader import make_reader

from evis.bag import BagError, environments
from evis.bag.info import describe
from evis.bag.reader import BagReader
from evis.bag.ros import mapping, transforms
from evis.bag.writer import BagWriter
from msgs.camera import EventPacket, EventSignal, Keyframe, Labels, Samples
from msgs.diagnostics import Diagnostics
from msgs.fields import array_specs
from msgs.header import Header, Message
from msgs.topics import TOPICS
from msgs.world import WorldState

TOPIC_OF = {row.type.__name__: row.pattern.replace("<cam>", "cam0") for row in TOPICS}


def through(messages, folder, **options):
    path = Path(folder) / "a.mcap"
    with BagWriter(path, **options) as writer:
        for topic, message in messages:
            writer.write(topic, message)
    with BagReader(path) as reader:
        back = [(topic, copied(message)) for topic, message in reader.messages()]
        assert reader.skipped == 0, reader.first_problem
        assert reader.problem == ""
    return back


HEADERS = st.builds(
    Header, st.integers(0, 2**31 * 10**9 - 1), st.integers(0, 2**62), st.text(max_size=8), st.integers(0, 2**31)
)
SCALARS = {
    "int": st.integers(-(2**63), 2**63 - 1),
    "float": st.floats(allow_nan=False),
    "str": st.text(max_size=9),
    "list[str]": st.lists(st.text(max_size=9), max_size=4),
    "dict[str, Any]": st.dictionaries(
        st.text(max_size=5),
        st.recursive(
            st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5) | st.binary(),
            lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
            max_leaves=5,
        ),
        max_size=3,
    ),
}
SMALL = {"width", "height", "t0_ns"}
"""Fields that ROS keeps in 32 bits, or that are times."""


@st.composite
def instances(draw, kind):
    """Any message of this type that its declaration allows, with few and small axes, and E = 1."""
    lengths = {"E": 1}
    arrays = {}
    for name, spec in array_specs(kind).items():
        if spec.optional and draw(st.booleans()):
            continue
        shape = []
        for dim in spec.dims:
            if dim == "?":
                shape.append(draw(st.integers(0, 3)))
            elif isinstance(dim, int):
                shape.append(dim)
            else:
                shape.append(lengths.setdefault(dim, draw(st.integers(0, 3))))
        dtype = np.dtype(draw(st.sampled_from(spec.dtypes)))
        elements = None
        if name == "t" or (kind is EventPacket and name == "env_offsets"):
            elements = st.integers(0, 2**31 * 10**9 - 1)
        if name.endswith("_env"):
            elements = st.integers(0, 0)
        arrays[name] = draw(hnp.arrays(dtype, tuple(shape), elements=elements))
    scalars = {}
    for field in dataclasses.fields(kind):
        if field.name == "header" or field.name in array_specs(kind):
            continue
        values = st.integers(0, 2**32 - 1) if field.name in SMALL else SCALARS[str(field.type)]
        scalars[field.name] = draw(values)
    if kind is WorldState:
        bodies, steps = arrays["end_pose"].shape[1], len(arrays["t"])
        chosen = draw(st.sets(st.integers(0, bodies - 1))) if bodies else set()
        arrays["moving"] = np.array(sorted(chosen), np.int32)
        for name, size in (("moving_pose", 7), ("moving_twist", 6)):
            arrays[name] = draw(hnp.arrays(np.float64, (1, steps, len(chosen), size)))
        if steps and draw(st.booleans()):
            arrays["end_pose"][:, arrays["moving"]] = arrays["moving_pose"][:, -1]
    if kind is Samples:
        image = arrays.get("rgb", arrays.get("luminance"))
        pixels = 1 if image is None else image.shape[2] * image.shape[3]
        count = len(arrays["offset"]) if pixels else 0
        arrays |= {name: array[:count] for name, array in arrays.items() if name in ("further", "further_rgb")}
        arrays["first"] = np.append(np.zeros(pixels, np.int32), np.int32(count))
        arrays["offset"] = np.arange(1, count + 1, dtype=np.int32)
    message = kind(draw(HEADERS), **arrays, **scalars)
    message.header.clock = message.header.clock or "sim"
    return message


@pytest.mark.parametrize("kind", sorted(TOPIC_OF))
@settings(max_examples=30, deadline=None)
@given(data=st.data())
def test_every_message_type(kind, data):
    """Random values of every field, NaN payloads and infinities in arrays, empty axes, absent arrays."""
    message = data.draw(instances(Message.TYPES[kind]))
    if isinstance(message, EventPacket):
        message.env_offsets = np.array([0, 0 if message.t is None else len(message.t)], np.int64)
    if isinstance(message, EventSignal):
        message.env_offsets = np.array([0, len(message.signal)], np.int64)
    if isinstance(message, WorldState):
        message.t = message.t % (2**31 * 10**9)
    with tempfile.TemporaryDirectory() as folder:
        back = through([(TOPIC_OF[kind], message)], folder)
    assert [t for t, _ in back] == [TOPIC_OF[kind]]
    assert same(back[0][1], message)


@pytest.mark.parametrize("envs", [1, 2, 3])
def test_a_whole_scene(tmp_path, envs):
    """All topics over several keyframes, environments joined again, in data-flow order within a stamp."""
    sent = [(topic, m) for k in range(4) for topic, m in scene(k, envs).items()]
    back = through(sent, tmp_path)
    assert len(back) == len(sent)
    expected = {}
    for topic, message in sent:
        expected.setdefault(topic, []).append(message)
    for topic, message in back:
        other = expected[topic].pop(0)
        if topic == "/diagnostics":  # NaN is not equal to itself
            assert math.isnan(message.values.pop("x")) and math.isnan(other.values.pop("x"))
        assert same(message, other), topic
    stamps = [m.header.stamp_ns for t, m in back if t != "/diagnostics"]
    assert stamps == sorted(stamps)
    table = [row.type for row in TOPICS]
    for k in range(4):
        ranks = [table.index(type(m)) for t, m in back if m.header.seq == k]
        assert ranks == sorted(ranks)


def test_environments_are_topics_as_of_single_runs(tmp_path):
    """/env1/cam0/keyframe holds what a single run of that environment would have recorded."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    message = scene(1, 2)["/cam0/keyframe"]
    through([("/cam0/keyframe", message)], tmp_path)
    with open(tmp_path / "a.mcap", "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        images = {
            channel.topic: image
            for schema, channel, _, image in reader.iter_decoded_messages(
                ["/env0/cam0/keyframe", "/env1/cam0/keyframe"]
            )
        }
    for e in range(2):
        image = images[f"/env{e}/cam0/keyframe"]
        assert image.encoding == "32FC3" and bytes(image.data) == message.radiance[e].tobytes()


def test_half_precision_radiance(tmp_path):
    half = np.array([[[[1.5, 6e4, np.nan], [np.inf, -0.0, 6e-8]]]], np.float16)
    ((_, back),) = through([("/cam0/keyframe", Keyframe(Header(5), np.zeros(1, np.int32), half))], tmp_path)
    assert back.radiance.dtype == np.float16 and back.radiance.tobytes() == half.tobytes()


def test_large_state_and_odd_names(tmp_path):
    """More numbers than are listed in JSON, fewer names than bodies."""
    rng = np.random.default_rng(0)
    s, n = 40, 9
    state = WorldState.dense(
        Header(10**9),
        np.arange(s),
        rng.normal(size=(1, s, n, 7)),
        rng.normal(size=(1, s, n, 6)),
        np.zeros(1, np.int32),
        names=["only", "two"],
    )
    state.moving_pose[0, 3, 4, 5] = np.nan
    assert same(through([("/state", state)], tmp_path)[0][1], state)


@pytest.mark.parametrize("envs", [1, 2])
def test_states_of_bags_from_before_bodies_that_stand_were_told_apart(envs):
    """Their transforms are all sub-steps of all bodies, sub-step by sub-step; the twists are in the closing text."""
    rng = np.random.default_rng(3)
    t, names = np.array([5, 6, 9]), ("cam0", "a")
    pose, twist = rng.normal(size=(envs, 3, 2, 7)), rng.normal(size=(envs, 3, 2, 6))
    parts = []
    for e in range(envs):
        body = {"header": {"stamp_ns": 9, "seq": 1, "clock": "sim", "episode": 0}, "names": list(names)}
        body |= {"t": t.tolist(), "twist": twist[e : e + 1].tolist(), "episodes": [0], "_steps": 3, "_bodies": 2}
        raw = transforms.pack("world", [(names, t, pose[e])])
        parts.append((mapping.decode("WorldState", {"pose": [memoryview(raw)]}, body), {}))
    state = environments.join(parts)
    assert np.array_equal(state.rows()[0], pose) and np.array_equal(state.rows()[1], twist)
    assert np.array_equal(state.end_pose, pose[:, -1]) and state.names == list(names)
    whole = {**body, "pose": pose.tolist(), "twist": twist.tolist(), "episodes": [0] * envs}
    del whole["_steps"], whole["_bodies"]
    assert np.array_equal(mapping.decode("WorldState", {}, whole).rows()[0], pose)


def test_a_state_of_bodies_that_there_are_not_is_refused():
    body = {"header": {"stamp_ns": 9, "seq": 1, "clock": "sim", "episode": 0}, "names": ["a"], "t": [9]}
    body |= {"moving": [1], "moving_twist": np.zeros((1, 1, 1, 6)).tolist(), "episodes": [0], "_steps": 1, "_bodies": 1}
    raw = memoryview(transforms.pack("world", [(("a",), np.array([9]), np.zeros((1, 1, 7)))]))
    with pytest.raises(BagError, match="names bodies 1 to 1 of 1"):
        mapping.decode("WorldState", {"pose": [raw]}, body)
    with pytest.raises(BagError, match="too few for 1000 steps"):
        mapping.decode("WorldState", {"pose": [raw]}, {**body, "moving": [0], "_steps": 1000})
    del body["_steps"]
    body |= {"end_pose": [[[0.0] * 7]], "moving_pose": [[[[0.0] * 7]]]}
    with pytest.raises(BagError, match="ascending list of bodies"):
        mapping.decode("WorldState", {}, body)


def test_packets_longer_than_mono_can_count(tmp_path):
    """Times over more than 4.29 s, out of order, and rows and polarities beyond mono's bits."""
    rng = np.random.default_rng(0)
    n = 300
    for y_max, p_max in ((260, 2), (65536, 250)):
        packet = EventPacket(
            Header(40 * 10**9),
            np.array([0, n]),
            rng.integers(0, 40 * 10**9, n),
            rng.integers(0, 65536, n).astype(np.uint16),
            rng.integers(0, y_max, n).astype(np.uint16),
            rng.integers(0, p_max, n).astype(np.uint8),
            t0_ns=7,
            width=346,
        )
        assert same(through([("/cam0/events", packet)], tmp_path)[0][1], packet)


def test_raw_packets_with_and_without_arrays(tmp_path):
    raw = np.arange(10, dtype=np.uint8)
    header = Header(9, clock="device:1")
    only = EventPacket(header, np.array([0, 0]), raw=raw, encoding="evt3", width=346, height=260, t0_ns=3)
    both = dataclasses.replace(
        only,
        env_offsets=np.array([0, 1]),
        t=np.array([5]),
        x=np.array([1], np.uint16),
        y=np.array([2], np.uint16),
        p=np.array([1], np.uint8),
    )
    for packet in (only, both):
        assert same(through([("/cam0/events", packet)], tmp_path)[0][1], packet)


def test_evt3_keeps_whole_microseconds(tmp_path):
    """Selected by hand, evt3 gives x, y, p and floor(t / 1 us), over the turns of its 24-bit counter (16.8 s)."""
    rng = np.random.default_rng(3)
    packets = []
    for k in range(30):
        n = int(rng.integers(0, 50))
        t = np.sort(rng.integers(k * 10**9 + 1, (k + 1) * 10**9, n))
        packets.append(
            EventPacket(
                Header((k + 1) * 10**9, k),
                np.array([0, n]),
                t,
                rng.integers(0, 346, n).astype(np.uint16),
                rng.integers(0, 260, n).astype(np.uint16),
                rng.integers(0, 2, n).astype(np.uint8),
                width=346,
                height=260,
                t0_ns=k * 10**9,
            )
        )
    back = through([("/cam0/events", p) for p in packets], tmp_path, event_encoding="evt3")
    assert len(back) == len(packets)
    for (_, got), packet in zip(back, packets):
        assert np.array_equal(got.t, packet.t // 1000 * 1000)
        for name in "xyp":
            assert np.array_equal(getattr(got, name), getattr(packet, name))


def test_tables_that_are_not_sorted_by_environment(tmp_path):
    env = np.array([1, 0, 1, 0, 0], np.int32)
    labels = Labels(
        Header(1),
        flow=np.zeros((2, 1, 1, 2), np.float32),
        box=np.arange(20, dtype=np.float32).reshape(5, 4),
        box_env=env,
        box_id=np.arange(5, dtype=np.int32),
        contact_env=env[:2],
        contact_body=np.array([[0, 1], [2, -1]], np.int32),
    )
    assert same(through([("/cam0/labels", labels)], tmp_path)[0][1], labels)


def test_wall_clock_messages_do_not_stretch_the_bag(tmp_path):
    """Diagnostics carry wall times; they are filed under the simulation's time and come back as they were."""
    wall = Diagnostics(Header(1_790_000_000_000_000_000, 0, "wall"), "n")
    sent = [("/cam0/keyframe", scene(0)["/cam0/keyframe"]), ("/diagnostics", wall), ("/state", scene(3)["/state"])]
    back = through(sent, tmp_path)
    assert [t for t, _ in back] == ["/diagnostics", "/cam0/keyframe", "/state"] and same(back[0][1], wall)
    with BagReader(tmp_path / "a.mcap") as reader:
        assert (reader.start_ns, reader.end_ns) == (0, 10**8)


def test_wall_clock_messages_after_a_reset(tmp_path):
    """They are filed under the time of the new episode: those of all of it stood at the end of the one before."""
    wall = [Diagnostics(Header(1_790_000_000_000_000_000 + k, k, "wall"), "n") for k in range(2)]
    again = scene(1)["/state"]
    again.header.episode = 1
    sent = [("/state", scene(3)["/state"]), ("/diagnostics", wall[0]), ("/state", again), ("/diagnostics", wall[1])]
    assert len(through(sent, tmp_path)) == len(sent)
    with open(tmp_path / "a.mcap", "rb") as file:
        filed = [m.log_time for _, _, m in make_reader(file).iter_messages("/diagnostics", log_time_order=False)]
    assert filed == [scene(3)["/state"].header.stamp_ns, again.header.stamp_ns]


def test_wall_clock_messages_before_all_others(tmp_path):
    """They are filed with the first message of another clock; alone, they keep the wall's time."""
    wall = [Diagnostics(Header(1_790_000_000_000_000_000 + k, k, "wall"), "n") for k in range(3)]
    first = scene(3)["/state"]
    back = through([*(("/diagnostics", m) for m in wall), ("/state", first)], tmp_path)
    assert sorted(t for t, _ in back) == ["/diagnostics"] * 3 + ["/state"]
    assert all(same(a, b) for a, b in zip((m for t, m in back if t == "/diagnostics"), wall))
    about = describe(tmp_path / "a.mcap")
    assert (about["start_ns"], about["end_ns"], about["duration_s"]) == (first.header.stamp_ns,) * 2 + (0.0,)
    through([("/diagnostics", m) for m in wall], tmp_path)
    about = describe(tmp_path / "a.mcap")
    assert (about["start_ns"], about["end_ns"]) == (1_790_000_000_000_000_000, 1_790_000_000_000_000_002)


def test_duration_of_a_bag_that_has_diagnostics_under_wall_time(tmp_path, monkeypatch):
    """As when too many came before the first message to wait for it: they do not count beside its time."""
    monkeypatch.setattr("evis.bag.writer._MOST_EARLY", 0)
    wall = Diagnostics(Header(1_790_000_000_000_000_000, 0, "wall"), "n")
    through([("/diagnostics", wall), ("/state", scene(0)["/state"]), ("/state", scene(3)["/state"])], tmp_path)
    with BagReader(tmp_path / "a.mcap") as reader:
        assert reader.end_ns == wall.header.stamp_ns
    assert describe(tmp_path / "a.mcap")["duration_s"] == pytest.approx(0.1)


def test_episodes_whose_time_starts_anew(tmp_path):
    """Order is by episode first, also where the bag's chunks overlap in time."""
    keyframe = scene(0)["/cam0/keyframe"]
    sent = [
        ("/cam0/keyframe", dataclasses.replace(keyframe, header=Header(k * 10**7, k, "sim", episode)))
        for episode in range(3)
        for k in range(20)
    ]
    back = through(sent, tmp_path, chunk_bytes=2000)
    assert [(m.header.episode, m.header.stamp_ns) for _, m in back] == [
        (m.header.episode, m.header.stamp_ns) for _, m in sent
    ]


def test_topics_arriving_late_are_put_in_order(tmp_path):
    """A topic that lags behind the others by many chunks."""
    frames = [scene(k)["/cam0/keyframe"] for k in range(30)]
    events = [scene(k)["/cam0/events"] for k in range(30)]
    sent = [("/cam0/keyframe", f) for f in frames[:10]]
    for k in range(20):
        sent += [("/cam0/keyframe", frames[10 + k]), ("/cam0/events", events[k])]
    back = through(sent, tmp_path, chunk_bytes=1500)
    assert len(back) == len(sent)
    stamps = [m.header.stamp_ns for _, m in back]
    assert stamps == sorted(stamps)


def test_time_range_and_topics(tmp_path):
    through([(t, m) for k in range(6) for t, m in scene(k).items()], tmp_path, chunk_bytes=3000)
    with BagReader(tmp_path / "a.mcap") as reader:
        some = list(reader.messages(["/state", "/cam0/depth"], round(1e9 / 30), round(4e9 / 30)))
        assert (
            [m.header.seq for t, m in some if t == "/state"]
            == [1, 2, 3, 4]
            == [m.header.seq for t, m in some if t == "/cam0/depth"]
        )
        assert len(some) == 8
        with pytest.raises(BagError, match="no topic '/cam1/depth'; it has"):
            list(reader.messages(["/cam1/depth"]))


def test_times_before_zero_are_refused(tmp_path):
    with BagWriter(tmp_path / "a.mcap") as writer, pytest.raises(BagError, match=r"0 to 2\^31 s"):
        writer.write("/state", dataclasses.replace(scene(0)["/state"], header=Header(-1)))


def test_values_that_look_like_the_bags_own(tmp_path):
    values = {
        "a": {"$float": "nan"},
        "b": {"$map": {"$bytes": 1}},
        "c": {"$bytes": b"\x00"},
        "d": 2**70,
        "e": (1, -0.0),
    }
    ((_, back),) = through([("/diagnostics", Diagnostics(Header(2**53 + 1), values=values))], tmp_path)
    assert back.values == {**values, "e": [1, -0.0]} and math.copysign(1, back.values["e"][1]) == -1
    assert back.header.stamp_ns == 2**53 + 1


def test_unknown_event_encoding(tmp_path):
    with pytest.raises(BagError, match="must be one of mono, evt3"):
        BagWriter(tmp_path / "a.mcap", event_encoding="evt4")
    assert not (tmp_path / "a.mcap").exists()


def test_metadata_that_names_a_file_whose_name_is_not_utf8_is_written(tmp_path):
    with BagWriter(tmp_path / "a.mcap", {"evis": {"arg.bag": "a\udcff.mcap"}}):
        pass
    with (tmp_path / "a.mcap").open("rb") as file:
        assert [m.metadata for m in make_reader(file).iter_metadata()] == [{"arg.bag": "a\\udcff.mcap"}]
