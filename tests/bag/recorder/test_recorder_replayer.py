"""The two nodes, driven as the executor drives them."""

import dataclasses
import time
from collections import defaultdict

import numpy as np
import pytest
from bag_messages import copied, same, scene
from hand_driven_nodes import make_node
from mcap.writer import Writer

from evis.bag import BagError
from evis.bag.info import describe
from evis.bag.reader import BagReader
from evis.bag.writer import BagWriter
from evis.config.params import ParamError
from msgs.camera import Depth
from msgs.header import Header
from nodes.recorder.node import RecorderNode
from nodes.replayer.choice import topics_to_play
from nodes.replayer.node import ReplayerNode

PIXEL = np.ones((1, 1, 1), np.float32)


def record(path, keyframes=6, topics=(), envs=1, without=None, **params):
    node = make_node(RecorderNode, path=str(path), topics=list(topics), **params)
    node.runtime.plan.topics = {t: None for t in scene(0) if t != without}
    node.setup()
    for k in range(keyframes):
        for topic, message in scene(k, envs).items():
            if topic != without:
                node.receive(topic, message)
    node.finish()
    node.close()
    return node


def contents(path):
    with BagReader(path) as reader:
        assert reader.problem == ""
        return [(t, copied(m)) for t, m in reader.messages()]


def replay(path, **params):
    node = make_node(ReplayerNode, bag=str(path), **params)
    node.setup()
    steps = []
    while True:
        before = len(node.runtime.published)
        alive = node.step({})
        steps.append(node.runtime.published[before:])
        if not alive:
            break
    node.finish()
    node.close()
    return node, steps


def test_default_topics_and_preview(tmp_path):
    node = record(tmp_path / "a.mcap", keyframes=10, without="/cam0/image")
    back = contents(tmp_path / "a.mcap")
    topics = {t for t, _ in back}
    assert {"/state", "/cam0/events", "/cam0/info", "/cam0/image", "/cam0/labels", "/action"} <= topics
    assert not topics & {"/cam0/keyframe", "/cam0/depth", "/cam0/frames", "/clock"}
    assert node.runtime.counters["previews"] == 4
    assert node.runtime.counters["messages"] == sum(1 for t, m in back) - node.runtime.counters["previews"]


def test_preview_runs_at_its_own_rate(tmp_path):
    node = make_node(RecorderNode, path=str(tmp_path / "a.mcap"), preview_hz=10.0)
    node.setup()
    for k in range(31):
        keyframe = scene(k)["/cam0/keyframe"]
        keyframe.margin = 1
        node.receive("/cam0/keyframe", keyframe)
    node.close()
    images = [m for _, m in contents(tmp_path / "a.mcap")]
    assert [round(m.header.stamp_ns * 30 / 1e9) for m in images] == [0, 3, 6, 9, 12, 15, 18, 21, 24, 27, 30]
    assert all(m.encoding == "rgb8" and m.data.shape == (3, 5, 3) for m in images)


def test_preview_of_environments_and_episodes(tmp_path):
    node = make_node(RecorderNode, path=str(tmp_path / "a.mcap"))
    node.setup()
    for episode in range(2):
        for k in range(3):
            keyframe = scene(k, 2)["/cam0/keyframe"]
            node.receive(
                "/cam0/keyframe", dataclasses.replace(keyframe, header=Header(k * 33_333_333, k, "sim", episode))
            )
    node.close()
    images = contents(tmp_path / "a.mcap")
    assert [(t, m.header.episode, m.header.stamp_ns) for t, m in images] == [
        ("/env0/cam0/image", 0, 0),
        ("/env0/cam0/image", 1, 0),
    ]


def test_topics_by_glob(tmp_path):
    record(tmp_path / "a.mcap", topics=["/cam0/key*", "/*/depth"], preview_hz=0.0)
    topics = {t for t, _ in contents(tmp_path / "a.mcap")}
    assert {"/cam0/keyframe", "/cam0/depth", "/state"} <= topics and "/cam0/motion" not in topics


def test_what_the_planner_is_told():
    available = [
        "/state",
        "/cam0/keyframe",
        "/cam0/depth",
        "/cam0/frames",
        "/cam0/events",
        "/cam1/keyframe",
        "/cam1/image",
    ]
    told = RecorderNode.dynamic_inputs({}, available)
    assert told == ["/state", "/cam0/events", "/cam1/image", "/cam0/keyframe"]
    assert RecorderNode.dynamic_inputs({"preview_hz": 0}, available) == ["/state", "/cam0/events", "/cam1/image"]
    # sub-frames are a thousand times the data and can be made again: never by a glob that does not name them
    everything = RecorderNode.dynamic_inputs({"topics": ["*"]}, available)
    assert set(everything) == set(available) - {"/cam0/frames"}
    assert "/cam0/frames" in RecorderNode.dynamic_inputs({"topics": "/*/frames"}, available)
    with pytest.raises(ParamError, match="no topic is like '/cam0/keyfrane'"):
        RecorderNode.dynamic_inputs({"topics": ["/cam0/keyfrane"]}, available)


def test_topics_that_no_node_publishes_are_told(tmp_path):
    """The table knows triggers, but a simulator has none: the bag lacked them without a word."""
    node = make_node(RecorderNode, path=str(tmp_path / "a.mcap"), topics=["/cam0/trigger", "*/depth"])
    node.runtime.plan.topics = dict.fromkeys(["/cam0/events", "/cam0/depth"])
    node.setup()
    assert [level for level, text in node.runtime.said if "/cam0/trigger" in text] == ["warning"]
    assert len(node.runtime.said) == 1
    node.finish()
    node.close()


def test_the_run_is_described_in_the_bag(tmp_path):
    record(tmp_path / "a.mcap", keyframes=1)
    with BagReader(tmp_path / "a.mcap") as reader:
        assert reader.metadata["launch"]["text"] == "nodes: {}\n" and reader.metadata["evis"]["seed"] == "5"
        assert reader.metadata["parameters"]["physics"] == '{"omega": 60.0}'


@pytest.mark.parametrize(
    ("numbers", "lost"), [((0, 1, 4, 5, 9), 5), ((0, 1, 7, 2, 4), 8)], ids=["one publisher", "started again after 7"]
)
def test_losses_are_counted_and_kept(tmp_path, numbers, lost):
    """A publisher that is started again numbers its messages from 0: of its first ones two are lost, and one later."""
    node = make_node(RecorderNode, path=str(tmp_path / "a.mcap"))
    node.setup()
    for k in numbers:
        node.receive("/cam0/events", scene(k)["/cam0/events"])
        node.receive("/diagnostics", scene(k)["/diagnostics"])  # many publishers: their numbers tell nothing
    node.close()
    assert node.runtime.counters["lost"] == lost
    with BagReader(tmp_path / "a.mcap") as reader:
        assert reader.metadata["lost"] == {"/cam0/events": str(lost)}


def test_an_older_recording_is_kept_and_that_is_said(tmp_path):
    record(tmp_path / "a.mcap", keyframes=1)
    node = record(tmp_path / "a.mcap", keyframes=2)
    assert [level for level, _ in node.runtime.said] == ["info"] and "a.mcap.bak" in node.runtime.said[0][1]
    assert len(contents(tmp_path / "a.mcap.bak")) < len(contents(tmp_path / "a.mcap"))


def test_a_path_that_cannot_be_written_ends_before_the_start(tmp_path):
    node = make_node(RecorderNode, path=str(tmp_path / "missing" / "a.mcap"))
    with pytest.raises(BagError, match="there is no directory"):
        node.setup()
    node.close()


ALL = ["/*/keyframe", "/*/depth", "/*/motion", "/*/ids", "/*/normal", "/*/frames", "/*/samples", "/*/signal", "/clock"]


@pytest.mark.parametrize("envs", [1, 2])
def test_replay_is_what_was_recorded(tmp_path, envs):
    """Every message bit by bit on its topic, one stamp per step, data flow in order, no topic twice in a step."""
    record(tmp_path / "a.mcap", topics=ALL, envs=envs)
    node, steps = replay(tmp_path / "a.mcap")
    sent = defaultdict(list)
    for topic, message in node.runtime.published:
        sent[topic].append(message)
    left_out = {"/clock", "/diagnostics"}
    for topic in scene(0):
        expected = [] if topic in left_out else [scene(k, envs)[topic] for k in range(6)]
        assert len(sent[topic]) == len(expected), topic
        assert all(same(a, b) for a, b in zip(sent[topic], expected)), topic
    for step in steps[:6]:
        assert len({m.header.stamp_ns for _, m in step}) == 1 and len({t for t, _ in step}) == len(step)
    names = [t for t, _ in steps[1]]
    assert (
        names.index("/state")
        < names.index("/cam0/keyframe")
        < names.index("/cam0/motion")
        < names.index("/cam0/events")
    )


def test_camera_info_comes_first(tmp_path):
    record(tmp_path / "a.mcap", keyframes=3)
    node = make_node(ReplayerNode, bag=str(tmp_path / "a.mcap"), start=1 / 30)
    node.setup()
    assert [(t, m.header.seq) for t, m in node.runtime.published] == [("/cam0/info", 0)]
    node.close()


def test_outputs_depend_on_the_bag(tmp_path):
    record(tmp_path / "a.mcap", keyframes=1, topics=ALL)
    outputs = ReplayerNode.dynamic_outputs({"bag": str(tmp_path / "a.mcap")})
    assert set(outputs) == set(scene(0)) - {"/clock", "/diagnostics"}
    assert all(port == output.topic for port, output in outputs.items())
    again = ReplayerNode.dynamic_outputs({"bag": str(tmp_path / "a.mcap"), "regenerate": "true"})
    assert set(outputs) - set(again) == {
        f"/cam0/{last}" for last in ("frames", "samples", "events", "signal", "labels")
    }
    some = ReplayerNode.dynamic_outputs(
        {"bag": str(tmp_path / "a.mcap"), "topics": "/cam0/*", "exclude": ["*/imu", "*/ids"]}
    )
    assert "/state" not in some and "/cam0/imu" not in some and "/cam0/depth" in some


@pytest.mark.parametrize(
    ("params", "told"),
    [({}, "/davis/image_raw, /note"), ({"topics": ["/davis/*"]}, "/davis/image_raw"), ({"exclude": ["*w", "/n*"]}, "")],
)
def test_what_is_not_played_of_another_recorders_bag_is_told(tmp_path, params, told):
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for topic, kind in {
            "/davis/events": "event_camera_msgs/msg/EventPacket", "/davis/image_raw": "sensor_msgs/msg/Image",
            "/note": "std_msgs/msg/String",
        }.items():  # fmt: skip
            writer.register_channel(topic, "cdr", writer.register_schema(kind, "ros2msg", b""))
        writer.finish()
    node = make_node(ReplayerNode, bag=str(path), **params)
    node.setup()
    node.close()
    assert "".join(text for _, text in node.runtime.said).partition("type: ")[2] == told


def test_errors_of_the_replayer(tmp_path):
    with pytest.raises(ParamError, match="which bag"):
        ReplayerNode.dynamic_outputs({})
    with pytest.raises(BagError, match="cannot read"):
        ReplayerNode.dynamic_outputs({"bag": "/nowhere/a.mcap"})
    record(tmp_path / "a.mcap", keyframes=1, preview_hz=0.0)
    with pytest.raises(BagError, match="holds no keyframes to regenerate from"):
        ReplayerNode.dynamic_outputs({"bag": str(tmp_path / "a.mcap"), "regenerate": True})
    (tmp_path / "torn.mcap").write_bytes((tmp_path / "a.mcap").read_bytes()[:60])
    with pytest.raises(BagError, match=r"torn.mcap ends before its first topic \(it ends within the record at byte"):
        ReplayerNode.dynamic_outputs({"bag": str(tmp_path / "torn.mcap")})
    record(tmp_path / "b.mcap", keyframes=4, preview_hz=0.0)  # the last one at 0.1 s
    assert ReplayerNode.dynamic_outputs({"bag": str(tmp_path / "b.mcap"), "start": 0.1})
    with pytest.raises(ParamError, match=r"start is 0.11 s, but .*b.mcap is 0.1 s long"):
        ReplayerNode.dynamic_outputs({"bag": str(tmp_path / "b.mcap"), "start": 0.11})
    for pace in ("fastt", "0", "-1", "nan"):
        with pytest.raises(ParamError, match="pace is"):
            make_node(ReplayerNode, bag=str(tmp_path / "a.mcap"), pace=pace).setup()


def test_start_and_duration(tmp_path):
    record(tmp_path / "a.mcap", keyframes=10)
    node, _ = replay(tmp_path / "a.mcap", start=0.1, duration=0.1, topics=["/state"])
    stamps = [m.header.stamp_ns for _, m in node.runtime.published]
    assert stamps == [round(k * 1e9 / 30) for k in (3, 4, 5, 6)]


@pytest.mark.parametrize("chunk_bytes", [1000, 1 << 20])
@pytest.mark.parametrize("torn", [False, True])
def test_start_and_duration_of_a_part_of_a_run(tmp_path, chunk_bytes, torn):
    """As `evis bag record` makes it beside a running graph: what describes a camera is of the run's start."""
    path = tmp_path / "a.mcap"
    with BagWriter(path, chunk_bytes=chunk_bytes) as writer:
        writer.write("/cam0/info", dataclasses.replace(scene(0)["/cam0/info"], header=Header(0)))
        for k in range(90, 100):
            writer.write("/state", scene(k)["/state"])
    if torn:
        path.write_bytes(path.read_bytes()[:-100])
    stamps = [round(k * 1e9 / 30) for k in range(90, 100)]
    about = describe(path)
    assert (about["start_ns"], about["end_ns"]) == (stamps[0], stamps[-1])
    with BagReader(path) as reader:
        assert (reader.start_ns, reader.end_ns) == (stamps[0], stamps[-1])
    node, _ = replay(path, start=0.1, duration=0.1)
    played = [(topic, m.header.stamp_ns) for topic, m in node.runtime.published]
    assert played == [("/cam0/info", 0), *(("/state", stamp) for stamp in stamps[3:7])]


@pytest.mark.parametrize(("duration", "part"), [(None, "from 0.15 s on"), (0.02, "from 0.15 to 0.17 s")])
def test_a_part_without_messages_of_the_chosen_topics_is_told(tmp_path, duration, part):
    """The camera's recording ends before the other one's: a replay of nothing said nothing."""
    with BagWriter(tmp_path / "a.mcap") as writer:
        for k in range(6):
            writer.write("/state", scene(k)["/state"])
            if k < 3:
                writer.write("/cam0/events", scene(k)["/cam0/events"])
    node, _ = replay(tmp_path / "a.mcap", topics=["/cam0/*"], start=0.15, duration=duration)
    assert not node.runtime.published
    (told,) = (text for level, text in node.runtime.said if level == "warning")
    assert told == f"{tmp_path / 'a.mcap'}: {part} there is no message of /cam0/events"
    node, _ = replay(tmp_path / "a.mcap", topics=["/state"], start=0.15, duration=duration)
    assert node.runtime.published and not node.runtime.said


def test_a_bag_of_descriptions_alone_has_their_time(tmp_path):
    with BagWriter(tmp_path / "a.mcap") as writer:
        for k in (3, 6):
            writer.write("/cam0/info", dataclasses.replace(scene(0)["/cam0/info"], header=Header(k)))
    with BagReader(tmp_path / "a.mcap") as reader:
        assert (reader.start_ns, reader.end_ns) == (3, 6)


def test_paced_replay_keeps_its_distances(tmp_path):
    """At speed 2, 0.2 s of stamps take at least 0.1 s of wall time, and no step sleeps for long."""
    record(tmp_path / "a.mcap", keyframes=7)
    node = make_node(ReplayerNode, bag=str(tmp_path / "a.mcap"), pace="2", topics=["/state"])
    node.setup()
    begin = time.monotonic()
    while node.step({}):
        pass
    assert time.monotonic() - begin >= 0.0999
    assert len(node.runtime.published) == 7
    node.close()


def test_paced_replay_keeps_the_distances_of_every_episode(tmp_path):
    """Of a bag of several episodes whose times begin anew, as of a recording that was played again and again."""
    with BagWriter(tmp_path / "a.mcap") as bag:
        for episode in range(3):
            for k in range(4):
                bag.write("/cam0/depth", Depth(Header(k * 40_000_000, 4 * episode + k, episode=episode), PIXEL))
    node = make_node(ReplayerNode, bag=str(tmp_path / "a.mcap"), pace="2")
    node.setup()
    began = time.monotonic()
    while node.step({}):
        pass
    node.close()
    assert len(node.runtime.published) == 12
    assert time.monotonic() - began > 3 * (3 * 0.040) / 2 - 0.01


def test_a_paced_replay_does_not_wait_between_two_clocks(tmp_path):
    """One camera counts from its start, the other from 1970: the replay waited for 50 years between the two."""
    late = 1_700_000_000_000_000_000
    with BagWriter(tmp_path / "a.mcap") as bag:
        for first, clock, name in (0, "device:1", "left"), (late, "device:2", "right"):
            for k in range(4):
                bag.write(f"/{name}/depth", Depth(Header(first + k * 40_000_000, k, clock), PIXEL))
    node = make_node(ReplayerNode, bag=str(tmp_path / "a.mcap"), pace="2")
    node.setup()
    began = time.monotonic()
    while node.step({}) and time.monotonic() - began < 5:
        pass
    node.finish()
    node.close()
    assert len(node.runtime.published) == 8
    assert 2 * (3 * 0.040) / 2 - 0.01 < time.monotonic() - began < 5
    assert node.runtime.results["pace"]["wanted"] == 2.0


def test_two_clocks_have_one_order_whatever_came_first(tmp_path):
    """By stamp, then by the data's way and the topic; the replay says that their times have nothing in common."""
    orders = []
    for seed in range(3):
        rng, path = np.random.default_rng(seed), tmp_path / f"{seed}.mcap"
        left = {"device:1": ["left", 0], "sim": ["right", 0]}
        with BagWriter(path, chunk_period_s=0.03) as bag:
            for clock, (name, _) in left.items():
                bag.write(f"/{name}/info", dataclasses.replace(scene(1, 1)["/cam0/info"], header=Header(0, 0, clock)))
            while left:
                clock = str(rng.choice(sorted(left)))
                name, k = left[clock]
                bag.write(f"/{name}/depth", Depth(Header(k // 2 * 10_000_000 + k % 2 * 3_000_000, k, clock), PIXEL))
                left[clock][1] += 1
                if k == 39:
                    del left[clock]
        node = make_node(ReplayerNode, bag=str(path))
        node.setup()
        while node.step({}):
            pass
        node.close()
        orders.append([(topic, m.header.clock, m.header.stamp_ns) for topic, m in node.runtime.published])
        depths = [entry for entry in orders[-1] if "depth" in entry[0]]
        assert depths == sorted(depths, key=lambda entry: (entry[2], entry[0])) and len(depths) == 80
        ((level, said),) = node.runtime.said
        assert level == "warning" and "the clocks device:1 (/left) and sim (/right) have no time in common" in said
    assert orders[0] == orders[1] == orders[2]
    alone = make_node(ReplayerNode, bag=str(tmp_path / "0.mcap"), topics=["/left/*"])
    alone.setup()
    assert not alone.runtime.said
    alone.close()


def test_the_rate_of_a_topic_is_that_within_its_episodes(tmp_path):
    """25 Hz, however often the time begins anew."""
    with BagWriter(tmp_path / "a.mcap") as bag:
        for episode in range(3):
            for k in range(4):
                bag.write("/cam0/depth", Depth(Header(k * 40_000_000, 4 * episode + k, episode=episode), PIXEL))
    topic = describe(tmp_path / "a.mcap")["topics"]["/cam0/depth"]
    assert topic["messages"] == 12 and topic["rate_hz"] == pytest.approx(25.0)


def test_a_paced_replay_tells_how_late_it_was(tmp_path):
    with BagWriter(tmp_path / "a.mcap") as bag:
        for k in range(3):
            bag.write("/cam0/depth", Depth(Header(k * 1_000_000, k), PIXEL))
    node = make_node(ReplayerNode, bag=str(tmp_path / "a.mcap"), pace="realtime")
    node.setup()
    publish = node.runtime.publish

    def slowly(*message):
        time.sleep(0.05)  # who takes it is behind
        publish(*message)

    node.runtime.publish = slowly
    while node.step({}):
        pass
    node.finish()
    node.close()
    assert 98 <= node.runtime.counters["late_ms_max"] < 5000  # two messages of 50 ms before a stamp of 2 ms
    pace = node.runtime.results["pace"]
    assert pace["wanted"] == 1.0 and pace["reached"] <= 0.02 and pace["late_ms_max"] >= 98


def test_a_pace_that_is_none_is_told_before_anything_starts(tmp_path):
    with BagWriter(tmp_path / "a.mcap") as bag:
        bag.write("/cam0/depth", Depth(Header(0), PIXEL))
    with pytest.raises(ParamError, match="pace is 'quick', must be realtime, fast or a speed"):
        ReplayerNode.dynamic_outputs({"bag": str(tmp_path / "a.mcap"), "pace": "quick"})


def test_again_and_again_as_further_episodes(tmp_path, monkeypatch):
    """The same stamps and arrays, the episodes going up, headers and arrays alike; latched descriptions once."""
    monkeypatch.setattr("nodes.replayer.node.REST_S", 0.0)
    topics = ["/state", "/cam0/keyframe", "/cam0/info"]
    record(tmp_path / "a.mcap", keyframes=3, topics=ALL)
    node = make_node(ReplayerNode, bag=str(tmp_path / "a.mcap"), topics=topics, again=True)
    node.setup()
    for _ in range(9):
        assert node.step({})
    sent = [m for topic, m in node.runtime.published if topic == "/state"]
    assert [m.header.episode for m in sent] == [0, 0, 0, 1, 1, 1, 2, 2, 2]
    assert [m.episodes.tolist() for m in sent] == [[0]] * 3 + [[1]] * 3 + [[2]] * 3
    frames = [m for topic, m in node.runtime.published if topic == "/cam0/keyframe"]
    for k in range(3):
        for later in (3, 6):
            assert sent[k].header.stamp_ns == sent[k + later].header.stamp_ns
            assert np.array_equal(sent[k].end_pose, sent[k + later].end_pose)
            assert np.array_equal(frames[k].radiance, frames[k + later].radiance)
    node.close()


@pytest.mark.parametrize(("start", "first"), [(0.0, "a"), (0.05, "b"), (0.1, "c")])
def test_the_description_is_that_of_the_time_played(tmp_path, monkeypatch, start, first):
    """A bag whose world changes twice: at each stamp of each round the last description written by then holds."""
    monkeypatch.setattr("nodes.replayer.node.REST_S", 0.0)
    worlds = {0: "a", 1: "b", 3: "c"}
    with BagWriter(tmp_path / "a.mcap") as writer:
        for k in range(5):
            messages = scene(k)
            if k == 1:  # two resets at one stamp: the second is what holds
                info = dataclasses.replace(messages["/cam0/info"], name="-", header=Header(round(1e9 / 30), 1))
                writer.write("/cam0/info", info)
            if k in worlds:
                header = Header(round(k * 1e9 / 30), k + 1)
                writer.write("/cam0/info", dataclasses.replace(messages["/cam0/info"], name=worlds[k], header=header))
            writer.write("/cam0/events", messages["/cam0/events"])
    node = make_node(ReplayerNode, bag=str(tmp_path / "a.mcap"), start=start, again=True)
    node.setup()
    assert [(topic, m.name) for topic, m in node.runtime.published] == [("/cam0/info", first)]
    while sum(topic == "/cam0/events" for topic, _ in node.runtime.published) < 15:
        assert node.step({})
    name, seen = "", []
    for topic, message in node.runtime.published:
        if topic == "/cam0/info":
            name = message.name
        else:
            k = round(message.header.stamp_ns * 30 / 1e9)
            seen.append((k, name, message.header.episode))
    ks = [k for k in range(5) if k / 30 >= start - 1e-9]
    written = ["a", "b", "b", "c", "c"]
    expected = [(k, written[k], episode) for episode in range(15) for k in ks]
    assert seen == expected[: len(seen)] and seen[-1][2] >= 2
    node.close()


def test_a_description_that_is_replaced_before_the_first_packet_is_played(tmp_path):
    """As settings of a camera are that change while nothing happens; whoever waits for a pace does not for these."""
    written = [(0, "a"), (0, "b"), (10_000_000, "c"), (50_000_000, "d")]
    with BagWriter(tmp_path / "a.mcap") as writer:
        for seq, (stamp, name) in enumerate(written):
            if name == "d":
                writer.write("/cam0/events", scene(1)["/cam0/events"])
            info = dataclasses.replace(scene(0)["/cam0/info"], name=name, header=Header(stamp, seq))
            writer.write("/cam0/info", info)
        writer.write("/cam0/events", scene(2)["/cam0/events"])
    messages = [(topic, m.header.stamp_ns, getattr(m, "name", "")) for topic, m in contents(tmp_path / "a.mcap")]
    for pace in ("fast", "0.5"):
        node, steps = replay(tmp_path / "a.mcap", pace=pace)
        played = [(topic, m.header.stamp_ns, getattr(m, "name", "")) for topic, m in node.runtime.published]
        assert played == messages and len(messages) == 6
        assert all(len({topic for topic, _ in step}) == len(step) for step in steps)
    node, _ = replay(tmp_path / "a.mcap", start=0.01)
    assert [m.name for topic, m in node.runtime.published if topic == "/cam0/info"] == ["c", "d"]


def test_replaying_a_torn_bag(tmp_path):
    record(tmp_path / "a.mcap", keyframes=6, topics=ALL)
    data = (tmp_path / "a.mcap").read_bytes()
    whole = len(replay(tmp_path / "a.mcap")[0].runtime.published)
    (tmp_path / "a.mcap").write_bytes(data[: len(data) // 2])
    node, _ = replay(tmp_path / "a.mcap")
    assert node.runtime.said[0][0] == "warning" and "torn" in node.runtime.said[0][1]
    assert len(node.runtime.published) < whole


@pytest.mark.parametrize("again", [False, True])
def test_replaying_a_wholly_damaged_bag(tmp_path, again):
    """Not a message can be read, and that is said and counted once, as where some can."""
    path = tmp_path / "a.mcap"
    record(path, keyframes=6, topics=ALL)
    data = bytearray(path.read_bytes())
    with BagReader(path) as reader:
        chunks = reader.scanner.layout.chunks
    for chunk in chunks:
        data[chunk.at + chunk.size // 2] ^= 0xFF
    path.write_bytes(data)
    node, steps = replay(path, again=again)
    assert steps == [[]] and node.runtime.counters["damaged"] == len(chunks)
    ((level, text),) = node.runtime.said
    assert level == "warning" and f"{len(chunks)} damaged parts left out: a chunk" in text


def test_several_messages_of_a_topic_at_one_stamp(tmp_path):
    """Each step publishes a topic once at the most: more could wait for credit inside the step."""
    with BagWriter(tmp_path / "a.mcap") as writer:
        for i in range(3):
            writer.write("/cam0/imu", dataclasses.replace(scene(0)["/cam0/imu"], header=Header(5, i)))
        writer.write("/cam0/trigger", dataclasses.replace(scene(0)["/cam0/trigger"], header=Header(5)))
    _, steps = replay(tmp_path / "a.mcap")
    assert [len({t for t, _ in s}) == len(s) for s in steps] == [True] * len(steps)
    assert sum(len(s) for s in steps) == 4


def test_a_recording_of_a_replay_is_the_recording(tmp_path):
    """Record, replay, record again: the same messages."""
    topics = ["/*/keyframe", "/*/depth"]
    record(tmp_path / "a.mcap", topics=topics, without="/cam0/image")
    node, _ = replay(tmp_path / "a.mcap")
    second = make_node(RecorderNode, path=str(tmp_path / "b.mcap"), topics=topics)
    second.runtime.plan.topics = dict.fromkeys(t for t, _ in node.runtime.published)
    second.setup()
    for topic, message in node.runtime.published:
        second.receive(topic, message)
    second.close()
    first = [(t, m) for t, m in contents(tmp_path / "a.mcap") if t != "/diagnostics"]
    again = contents(tmp_path / "b.mcap")
    assert [t for t, _ in first].count("/cam0/image") == 2
    assert len(first) == len(again) and all(a[0] == b[0] and same(a[1], b[1]) for a, b in zip(first, again))


def test_a_cameras_own_images_are_no_previews(tmp_path):
    """A camera that has images is recorded with these alone."""
    available = ["/cam0/keyframe", "/cam0/image"]
    assert RecorderNode.dynamic_inputs({}, available) == ["/cam0/image"]
    node = record(tmp_path / "a.mcap")
    assert node.runtime.counters["previews"] == 0
    images = [m for t, m in contents(tmp_path / "a.mcap") if t == "/cam0/image"]
    assert len(images) == 6 and all(same(m, scene(k)["/cam0/image"]) for k, m in enumerate(images))


def test_globs_that_no_topic_is_like_are_named():
    """Instead of a replay of nothing."""
    topics = {"/cam0/events": "EventPacket", "/cam0/info": "CameraInfo"}
    assert topics_to_play(topics, ["/cam0/ev*"], [], False, "a.mcap") == ["/cam0/events"]
    with pytest.raises(BagError, match=r"a.mcap has no topic to play that is like /cam1/\*; it has /cam0/events"):
        topics_to_play(topics, ["/cam1/*"], [], False, "a.mcap")
    with pytest.raises(BagError, match=r"a.mcap has no topic to play that is not like \*; it has /cam0/events"):
        topics_to_play(topics, [], ["*"], False, "a.mcap")
    with pytest.raises(BagError, match=r"that is like /cam0/\* and not like /cam0/\*; it has"):
        topics_to_play(topics, ["/cam0/*"], ["/cam0/*"], False, "a.mcap")
