"""The node in whole graphs: what is left out, environments and resets, gaps, and the same bytes however it is run."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import evis
from evis.bag.export.topics import export
from evis.bag.reader import BagReader
from evis.launch.attach import attach
from evis.launch.expand import NodeSpec
from evis.launch.planner import Options, plan_target
from msgs.camera import Image

SMALL = {"width": 64, "height": 48, "omega": 20.0, "audit": 0}
NOISY = {**SMALL, "preset": "davis346", "image_rate": 50.0, "image_phase_ms": 3.0}
MS = 1_000_000


def taken(steps):
    return [(i.header.stamp_ns, i.exposure_ns, i.env, i.data.tobytes()) for step in steps for i in step.images]


def launch(folder: Path, *words: str) -> dict:
    runtime = folder / "runtime"
    runtime.mkdir(exist_ok=True)
    given = [f"{name}:={value}" for name, value in NOISY.items()]
    done = subprocess.run(
        [sys.executable, "-m", "evis", "launch", "spinning_disk", *given, "image:=true", "exposure_ms:=18",
         "--duration", "0.1", "--no-view", "--json", *words],
        capture_output=True, text=True, timeout=300, env={**os.environ, "XDG_RUNTIME_DIR": str(runtime)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_without_image_nothing_is_computed():
    plan = plan_target("spinning_disk", SMALL, Options(0.1, view=False))
    assert plan.nodes["frame_camera"].dormant
    assert ("frame_camera", "nobody reads /cam0/image; started when a viewer opens it") in [
        (item.what, item.why) for item in plan.left_out
    ]
    asked = plan_target("spinning_disk", {**SMALL, "image": True}, Options(0.1, view=False))
    node = asked.nodes["frame_camera"]
    assert not node.dormant and node.process == asked.nodes["event_sensor"].process


def test_a_recording_has_the_preview_unless_there_are_images():
    """The topic is that of the preview: a node that is not started does not take its place."""
    for given, wanted in (({}, "/cam0/keyframe"), ({"image": True}, "/cam0/image")):
        plan = plan_target("spinning_disk", {**SMALL, **given}, Options(0.1, record="x.mcap", view=False))
        read = plan.nodes["recorder"].inputs["messages"]
        assert ("/cam0/keyframe" in read, "/cam0/image" in read) == (
            wanted == "/cam0/keyframe", wanted == "/cam0/image",
        )  # fmt: skip


def test_a_recorder_that_joins_a_running_graph_makes_its_preview(tmp_path):
    """Unless it is told to wait for images, or there are some."""
    for given, topics, wanted in (({}, [], False), ({}, ["/cam0/image"], True), ({"image": True}, [], True)):
        plan = plan_target("spinning_disk", {**SMALL, **given}, Options(0.1, view=False))
        attach(plan, NodeSpec("late", "recorder", "here", {"path": "x.mcap", "topics": topics}), tmp_path)
        read = plan.nodes["late"].inputs["messages"]
        assert ("/cam0/image" in read, "/cam0/keyframe" in read) == (wanted, not wanted)


def test_arguments_without_effect_are_refused():
    given = {**SMALL, "image": True, "exposure_ms": 4.0, "exposure_target": 0.1}
    with pytest.raises(ValueError, match=r"exposure_target:=0.1 has no effect: exposure_ms gives the exposure"):
        plan_target("spinning_disk", given, Options(0.1, view=False))


def test_the_events_are_the_same_with_images():
    with (
        evis.Simulation("spinning_disk", **SMALL) as without,
        evis.Simulation("spinning_disk", outputs=["events", "image"], **SMALL) as together,
    ):
        for step, other in zip(without.run(0.1), together.run(0.1), strict=True):
            for name in "txyp":
                np.testing.assert_array_equal(getattr(step.events, name), getattr(other.events, name))
        assert len(together.run(0.1)[-1].images) == 1


def test_several_images_of_a_step_come_in_order_and_those_of_a_rewound_run_are_the_same():
    """Images at 100 Hz between keyframes at 30 Hz. The last exposures do not end: they are counted."""
    asked = {**NOISY, "image_rate": 100.0, "exposure_ms": 6.0, "outputs": ["image"]}
    with evis.Simulation("spinning_disk", **asked) as sim:
        steps = sim.run(0.1)
        stamps = [i.header.stamp_ns for step in steps for i in step.images]
        assert stamps == [(3 + 3) * MS + n * 10 * MS for n in range(len(stamps))] and len(stamps) == 10
        assert max(len(step.images) for step in steps) == 4
        assert all((step.image is step.images[-1]) if step.images else step.image is None for step in steps)
        first = taken(steps)
        sim.reset(seed=1)
        assert taken(sim.run(0.1)) != first
        sim.reset(seed=0)
        assert taken(sim.run(0.1)) == first
        sim.finish()
        assert "unfinished_exposures" not in sim.summary()["frame_camera"]["counters"]
        sim.reset()
        sim.step()
        sim.finish()
        # 33.3 ms: that of 33 ms has begun.
        assert sim.summary()["frame_camera"]["counters"]["unfinished_exposures"] == 1


def test_an_environment_that_is_reset_begins_as_a_run_of_its_own():
    """Environment 1 is put back with seed 9 at 66.7 ms, in the middle of an exposure, and then shows what a single run
    with seed 9 shows; environment 0 goes on as a run by itself does."""
    asked = {**NOISY, "exposure_ms": 18.0, "outputs": ["events", "image"]}
    with evis.Simulation("spinning_disk", envs=2, seed=4, **asked) as sim:
        steps = [sim.reset(), sim.step(), sim.step()]
        at = sim.stamp_ns
        steps.append(sim.reset(seed=[9], envs=[1]))
        steps += [sim.step() for _ in range(3)]
        cut = sim.summary()["frame_camera"]["counters"]["exposures_cut_off"]
    found = taken(steps)
    with (
        evis.Simulation("spinning_disk", seed=4, **asked) as alone,
        evis.Simulation("spinning_disk", seed=9, **asked) as other,
    ):
        one, nine = taken(alone.run(5 / 30)), taken(other.run(3 / 30))
    assert [(s, x, d) for s, x, e, d in found if e == 0] == [(s, x, d) for s, x, _, d in one]
    after = [(s - at, x, d) for s, x, e, d in found if e == 1 and s > at]
    assert after == [(s, x, d) for s, x, _, d in nine] and len(nine) >= 4
    assert cut == 1


def test_keyframes_may_stand_for_frames():
    """interpolator none, and K = 1: images come of the keyframes. Just after a keyframe they show the same."""
    short = {**SMALL, "exposure_ms": 0.01, "image_gain": 20.0, "outputs": ["image"]}
    found = []
    for given in ({}, {"interpolator": "none"}, {"upsampling": 1}):
        with evis.Simulation("spinning_disk", **short, **given) as sim:
            found.append(sim.run(0.1))
    images = [[i.data for step in steps for i in step.images] for steps in found]
    assert len({len(each) for each in images}) == 1
    for other in images[1:]:
        np.testing.assert_allclose(np.stack(other).astype(int), np.stack(images[0]), atol=3)


def test_images_in_colour():
    with evis.Simulation("spinning_disk", colour=True, outputs=["image"], **SMALL) as sim:
        image = next(i for step in sim.run(0.04) for i in step.images)
    assert (image.encoding, image.data.shape) == ("rgb8", (48, 64, 3))
    assert np.ptp(image.data.astype(int), axis=2).max() > 0


def test_the_same_bytes_as_processes_and_stepped_in_one(tmp_path):
    bags = {}
    for name, words in {"processes": (), "split": ("--split",)}.items():
        told = launch(tmp_path, *words, "--record", str(tmp_path / f"{name}.mcap"))
        assert told["nodes"]["frame_camera"]["counters"]["unfinished_exposures"] == 1
        with BagReader(tmp_path / f"{name}.mcap") as reader:
            bags[name] = [m for _, m in reader.messages(["/cam0/image"])]
    with evis.Simulation("spinning_disk", outputs=["image"], exposure_ms=18.0, **NOISY) as sim:
        wanted = taken(sim.run(0.1))
    for messages in bags.values():
        assert all(isinstance(m, Image) and m.encoding == "mono16" for m in messages)
        assert [(m.header.stamp_ns, m.exposure_ns, m.env, m.data.tobytes()) for m in messages] == wanted
    told = export(tmp_path / "split.mcap", "/cam0/image", tmp_path / "png")
    assert told["images"] == len(wanted) == 4


def test_several_environments_in_a_bag_are_films_of_their_own(tmp_path):
    bag = tmp_path / "two.mcap"
    asked = {**NOISY, "exposure_ms": 5.0, "outputs": ["events", "image"], "envs": 2}
    with evis.Simulation("spinning_disk", **asked) as sim:
        steps = sim.run(0.1)
        sim.save(bag)
    with BagReader(bag) as reader:
        found = [m for _, m in reader.messages(["/cam0/image"])]
        names = {stream.channel.topic for stream in reader.streams.values() if stream.kind == "Image"}
    assert {"/env0/cam0/image", "/env1/cam0/image"} <= names
    key = lambda m: (m.header.stamp_ns, m.env)
    assert sorted(map(key, found)) == [(s, e) for s, _, e, _ in taken(steps)]
    with pytest.raises(ValueError, match="/cam0/image has 2 environments; name one of them: /env0/cam0/image"):
        export(bag, "/cam0/image", tmp_path / "both")
    told = export(bag, "/env1/cam0/image", tmp_path / "one")
    assert told["images"] == len(found) // 2
