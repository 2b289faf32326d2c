"""A graph held in Python gives what `evis launch` records, and begins anew as if it had never run."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import evis
from evis.bag.decoded import decoded_events
from evis.bag.reader import BagReader
from evis.scene import load_scene
from evis.scene.digest import appearance

SIZE = {"width": 64, "height": 48}


def recorded(bag: Path, topic: str = "/cam0/events") -> dict[str, bytes]:
    """All events of a bag, by column."""
    with BagReader(bag) as reader:
        parts = [events for _, events in decoded_events(reader, topic)]
    return {name: b"".join(np.asarray(getattr(p, name)).tobytes() for p in parts) for name in "txyp"}


def columns(steps: Iterable[Any]) -> dict[str, bytes]:
    """All events of some steps, by column."""
    packets = [step.events for step in steps]
    return {name: b"".join(getattr(p, name).tobytes() for p in packets) for name in "txyp"}


def launch(folder: Path, *words: str) -> dict[str, bytes]:
    """What the command line records in 0.2 s."""
    bag = folder / "launched.mcap"
    command = [sys.executable, "-m", "evis", "launch", *words, "--duration", "0.2", "--record", str(bag)]
    done = subprocess.run([*command, "--no-view", "--json"], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["events"] > 0
    return recorded(bag)


@pytest.mark.parametrize(
    ("scene", "arguments"),
    [
        ("spinning_disk", {"omega": 30, "shot_rate": 5.0}),
        ("spinning_disk", {"time_tolerance": 3e-4, "bandwidth_hz": 60.0, "photoreceptor_noise": 0.08}),
        ("robot_arm", {"threshold_mismatch": 0.03, "interpolator": "splat"}),
    ],
)
def test_the_events_are_those_that_evis_launch_records(scene: str, arguments: dict[str, Any], tmp_path: Path) -> None:
    words = [f"{key}:={value}" for key, value in {**SIZE, **arguments, "seed": 5}.items()]
    with evis.Simulation(scene, seed=5, **SIZE, **arguments) as sim:
        assert columns(sim.run(0.2)) == launch(tmp_path, scene, *words)


def test_a_reset_run_is_the_first_run_again() -> None:
    """Also after another seed, whose events are others."""
    with evis.Simulation("robot_arm", seed=2, shot_rate=10.0, **SIZE) as sim:
        first = columns(sim.run(0.2))
        sim.reset(seed=3)
        other = columns(sim.run(0.2))
        again = columns([sim.reset(), *sim.run(0.2)])
    assert first == again
    assert other != first


def test_the_time_of_one_keyframe_is_a_step_wherever_a_run_begins() -> None:
    """Stamps are whole ns: from 33,333,333 to 66,666,667 it is more than 1/30 s."""
    with evis.Simulation("spinning_disk", width=16, height=12, outputs=["state"]) as sim:
        assert len(sim.run(1 / 30)) == 2
        assert [len(sim.run(1 / 30)) for _ in range(5)] == [1] * 5
        assert sim.stamp_ns == 200_000_000 and len(sim.run(2 / 30)) == 2


def test_what_has_ended_goes_on_by_a_reset_of_all_alone() -> None:
    """Time cannot go on: an environment would be put back to a start that no step follows."""
    with evis.Simulation("spinning_disk", width=16, height=12, envs=2, outputs=["state"]) as sim:
        sim.run(0.1)
        sim.finish()
        for call in (sim.step, lambda: sim.run(0.1), lambda: sim.reset(envs=[0])):
            with pytest.raises(evis.SimulationError, match=r"has ended; reset\(\) begins anew"):
                call()
        sim.reset()
        sim.reset(envs=[0])
        assert len(sim.run(0.1)) == 3


def test_every_run_tells_of_its_camera_as_a_new_one_does() -> None:
    """CameraInfo comes once in a run, at keyframe 0, and has the seed of that run."""
    arguments: dict[str, Any] = {"outputs": ["events", "info"], "threshold_mismatch": 0.03, "shot_rate": 5.0, **SIZE}
    with evis.Simulation("spinning_disk", seed=2, **arguments) as sim:
        for seed in (2, 7, 7, 3):
            info = sim.reset(seed=seed).info
            with evis.Simulation("spinning_disk", seed=seed, **arguments) as new:
                expected = new.reset().info
            assert info.sensor["seed"] == seed and info.scalars() == expected.scalars()
            assert {name: a.tobytes() for name, a in info.arrays().items()} == {
                name: a.tobytes() for name, a in expected.arrays().items()
            }
            assert sim.step().info is None


def test_actions_reach_the_step_that_begins_at_their_stamp(tmp_path: Path) -> None:
    """The same states as with a controller node of a launch file, which answers every state; and the saved bag too."""
    (tmp_path / "swing_node.py").write_text(CONTROLLER)
    (tmp_path / "swung.yaml").write_text(SWUNG)
    launched = launch(tmp_path, str(tmp_path / "swung.yaml"), "width:=64", "height:=48")
    saved = tmp_path / "saved.mcap"
    with evis.Simulation("robot_arm", outputs=["events", "state"], **SIZE) as sim:
        steps = [sim.reset()]
        while steps[-1].stamp_ns < 0.2e9:
            steps.append(sim.step(np.full(6, 1e-9 * steps[-1].stamp_ns)))
        sim.save(saved)
    steps = [step for step in steps if step.stamp_ns <= 0.2e9]
    assert columns(steps) == launched
    assert recorded(saved) == launched
    with BagReader(saved) as reader:
        actions = [message for topic, message in reader.messages(["/action"])]
    assert [float(action.controls[0, 0]) for action in actions] == [1e-9 * step.stamp_ns for step in steps[:-1]]


CONTROLLER = """
import numpy as np
from evis.runtime.node import Input, Node, Output
from msgs.header import Header
from msgs.world import Action


class Swing(Node):
    INPUTS = {"state": Input("/state")}
    OUTPUTS = {"action": Output("/action")}

    def update(self, inputs):
        stamp = inputs["state"].header.stamp_ns
        self.publish("action", Action(Header(stamp), np.full((1, 6), 1e-9 * stamp)))
"""
SWUNG = """
include: {file: simulator, args: {scene: robot_arm}}
nodes:
  swing: {type: "swing_node:Swing"}
"""


def test_outputs_are_those_that_were_asked_for() -> None:
    """And no other: what nobody reads is not in the graph."""
    asked = ["depth", "frames", "left.labels.boxes", "state"]
    with evis.Simulation("stereo_room", outputs=asked, upsampling=4, **SIZE) as sim:
        sim.reset()
        step = sim.step()
        assert sim.cameras == ("left", "right")
        assert step.depth.shape == (1, 48, 64) and step.frames.luminance.shape == (1, 4, 48, 64)
        assert step.frames.t[-1] == step.stamp_ns == step.state.t[-1] == sim.stamp_ns
        assert len(step.labels.box) and step.labels.flow is None
        assert set(vars(step.cameras["right"])) == {"depth", "frames"}
        with pytest.raises(AttributeError, match="the step has no events; add 'events' to the `outputs`"):
            _ = step.events
        with pytest.raises(
            AttributeError, match=r"the step has no flow; .*step\.labels\.flow, where `outputs` has 'labels\.flow'"
        ):
            _ = step.flow
        with pytest.raises(AttributeError, match=r"the step has no flow; add 'labels\.flow' to the `outputs`"):
            _ = step.cameras["right"].flow
        with pytest.raises(AttributeError, match=r"the step has no dept; it has .*did you mean 'depth'\?"):
            _ = step.dept


def test_labels_of_events_may_be_asked_of_one_camera_and_events_of_all() -> None:
    """The labeler of the other camera waits for marks of noise that its sensor is not asked to make (`KeyError`)."""
    size: dict[str, Any] = {"width": 24, "height": 18}
    with evis.Simulation("stereo_room", outputs=["events", "left.labels.events"], **size) as sim:
        sim.reset()
        step = sim.step()
    left, right = step.cameras["left"], step.cameras["right"]
    assert len(left.labels.event_instance) == len(left.events.t) > 0 and len(right.events.t) > 0
    with evis.Simulation("spinning_disk", labels="events", outputs=["events"], **size) as sim:
        sim.reset()
        assert len(sim.step().events.t)


def test_what_a_step_gave_stays_as_it_was() -> None:
    """Memory that steps hold is not written again, however many are kept."""
    with evis.Simulation("spinning_disk", outputs=["keyframe", "depth", "frames", "events"], **SIZE) as sim:
        steps = [sim.reset()]
        copies = [np.copy(steps[0].keyframe)]
        for _ in range(70):
            steps.append(sim.step())
            copies.append(np.copy(steps[-1].keyframe))
        again = [sim.reset(), *(sim.step() for _ in range(5))]
    assert all(np.array_equal(step.keyframe, copy) for step, copy in zip(steps, copies))
    for before, now in zip(steps, again):
        assert np.array_equal(before.keyframe, now.keyframe) and np.array_equal(before.depth, now.depth)
        assert np.array_equal(before.frames.luminance, now.frames.luminance)
        assert before.events.t.tobytes() == now.events.t.tobytes()
        now.keyframe[:] = 0.0  # which is the caller's own


def test_images_among_the_outputs_bring_what_the_argument_brings(tmp_path: Path) -> None:
    """Beside `time_tolerance` they decide K, which is in the events."""
    given = {**SIZE, "omega": 20, "time_tolerance": 3e-4}
    words = [f"{key}:={value}" for key, value in {**given, "seed": 5, "image": "true"}.items()]
    with evis.Simulation("spinning_disk", outputs=["events", "cam0.image"], seed=5, **given) as sim:
        assert columns(sim.run(0.2)) == launch(tmp_path, "spinning_disk", *words)


def test_frames_beside_samples_stay_as_they_were() -> None:
    """Where there are samples between them, frames lie in the samples' memory: who keeps frames keeps that."""
    sampled = {"time_tolerance": 0.0003, "upsampling": 8, "omega": 20, **SIZE}
    with evis.Simulation("spinning_disk", outputs=["events", "frames"], **sampled) as simulation:
        simulation.reset(seed=0)
        frames = [simulation.step().frames for _ in range(6)]
        copies = [one.luminance.copy() for one in frames]
        for _ in range(6):
            simulation.step()
        assert [one.luminance.tobytes() for one in frames] == [one.tobytes() for one in copies]
        # The same frames, of which nobody had to wait for a later step.
        simulation.reset(seed=0)
        assert [simulation.step().frames.luminance.tobytes() for _ in range(6)] == [one.tobytes() for one in copies]


@pytest.mark.parametrize("scene", ["spinning_disk", "balls"])
def test_frames_and_what_comes_of_them_are_the_same_whoever_reads_samples_between(scene: str) -> None:
    """Of a frame sensor, and of an event sensor that takes frames alone."""
    given = {"time_tolerance": 0.0003, "defocus": 0.5, "upsampling": 3, "image_rate": 60.0, "exposure_ms": 5.0}
    found = []
    for outputs in (["events", "frames", "image"], ["events", "frames", "image", "samples"]):
        with evis.Simulation(scene, outputs=outputs, **SIZE, **given) as sim:
            steps = sim.run(0.1)
        frames = b"".join(step.frames.luminance.tobytes() for step in steps)
        images = [image.data.tobytes() for step in steps for image in step.images]
        assert len(images) > 3
        found.append((columns(steps), frames, images))
    assert found[0] == found[1]


def test_what_a_sensor_holds_back_comes_at_the_end(tmp_path: Path) -> None:
    with evis.Simulation("spinning_disk", crossing="monotone", **SIZE) as sim:
        steps = [*sim.run(0.2), sim.finish()]
    assert columns(steps) == launch(tmp_path, "spinning_disk", "width:=64", "height:=48", "crossing:=monotone")


def test_a_picture_shows_where_events_are() -> None:
    with evis.Simulation("spinning_disk", **SIZE) as sim:
        assert "<img" not in sim._repr_html_()
        step = sim.run(0.1)[-1]
        picture = sim.show()["cam0"]
        page = sim._repr_html_()
    grey = (picture == picture[..., :1]).all(axis=2)
    assert not grey[step.events.y, step.events.x].any()
    drawn = np.zeros_like(grey)
    drawn[step.events.y, step.events.x] = True
    assert (grey == ~drawn).all()
    assert page.count("<img") == 1 and "data:image/png;base64," in page


def test_a_picture_shows_the_world_that_its_environment_has_now() -> None:
    """Which it has by arguments or a seed of its own, also after a reset: the picture is that of it by itself."""
    drawn = {"vary": 1, **SIZE}

    def picture(scene: str, **given: Any) -> np.ndarray:
        with evis.Simulation(scene, **given) as sim:
            sim.reset()
            return sim.show()["cam0"]

    wanted = {seed: picture("falling_objects", seed=seed, **drawn) for seed in (3, 4, 9)}
    assert len({image.tobytes() for image in wanted.values()}) == 3
    with evis.Simulation("falling_objects", envs=2, seed=3, **drawn) as two:
        two.reset()
        for env in (0, 1, 0):
            assert (two.show(env)["cam0"] == wanted[3 + env]).all()
        two.reset(seed=[9], envs=[0])
        assert (two.show(0)["cam0"] == wanted[9]).all()
        assert appearance(two.scene) == appearance(load_scene("falling_objects", drawn, seed=9))
        two.reset(seed=8)
        assert (two.show(1)["cam0"] == wanted[9]).all()
    textures = [{"texture": 1}, {"texture": 2}]
    with evis.Simulation("spinning_disk", each=textures, **SIZE) as sim:
        sim.reset()
        for env, own in enumerate(textures):
            assert (sim.show(env)["cam0"] == picture("spinning_disk", **own, **SIZE)).all()


FLICKER = """\
cameras: {cam0: {position: [0, -2, 0], look_at: [0, 0, 0], fov: 60 deg}}
materials: {plain: {albedo: 0.6}}
bodies: {wall: {shapes: [{shape: box, size: [4, 0.1, 3], material: plain}]}}
lights:
  left: {kind: point, position: [-1, -1, 0], intensity: 2}
  right: {kind: point, position: [1, -1, 0], intensity: 2, flicker: {kind: sine, frequency: 10, depth: 1}}
"""


def test_a_picture_shows_lamps_at_the_time_of_its_environment(tmp_path: Path) -> None:
    """That of one that was reset by itself begins there; the other one's goes on."""
    scene = tmp_path / "flicker.yaml"
    scene.write_text(FLICKER)
    wanted = []
    with evis.Simulation(scene, outputs=["depth"], **SIZE) as sim:
        for go_on in (sim.reset, sim.step):
            go_on()
            wanted.append(sim.show()["cam0"])
    assert not (wanted[0] == wanted[1]).all()
    with evis.Simulation(scene, outputs=["depth"], envs=2, **SIZE) as sim:
        sim.step()
        sim.reset(envs=[0])
        for env in (0, 1):
            assert (sim.show(env)["cam0"] == wanted[env]).all()


def test_a_notebook_names_a_simulation_that_renders_nothing() -> None:
    with evis.Simulation("spinning_disk", outputs=["state"], **SIZE) as sim:
        sim.step()
        assert sim._repr_html_() == "<div>spinning_disk, 0.0333333 s</div>"


@pytest.mark.parametrize("which", [0, 1])
def test_a_replay_has_the_environments_and_episodes_of_its_bag(which: int, tmp_path: Path) -> None:
    """One of two was reset at 0.1 s: its episode is the next one from there on, and nothing has diverged."""
    bag = tmp_path / "reset.mcap"
    with evis.Simulation("spinning_disk", envs=2, keyframe_rate=20, upsampling=2, **SIZE) as sim:
        sim.run(0.1)
        sim.reset(envs=[which])
        sim.run(0.1)
        sim.save(bag)
    with evis.Simulation("replay", bag=bag) as sim:
        for _ in range(2):
            steps = [sim.reset()]
            while not steps[-1].over:
                steps.append(sim.step())
            assert sim.envs == 2
            told = {(step.stamp_ns, step.episodes[which], step.episodes[1 - which]) for step in steps}
            assert {(0, 0, 0), (50_000_000, 0, 0), (150_000_000, 1, 0), (200_000_000, 1, 0)} <= told
            assert all((episode == 0 or at >= 100_000_000) and not other for at, episode, other in told)
    with evis.Simulation("replay", bag=bag, exclude=["/state"]) as sim:
        step = sim.reset()
        while step.events is None:
            step = sim.step()
        assert sim.envs == 2 and len(sim.alone(step, 1).events.t) == np.diff(step.events.env_offsets)[1]


def test_a_replay_that_makes_events_anew_gives_them_all(tmp_path: Path) -> None:
    """With the run's own seed; a sensor that looks ahead holds the last gap back until the end."""
    bag = tmp_path / "keyframes.mcap"
    words = ("spinning_disk", "upsampling:=2", "crossing:=cubic", "shot_rate:=20", "timestamp_jitter_us:=500")
    size = [f"{key}:={value}" for key, value in SIZE.items()]
    topics = ",".join(f"/cam0/{name}" for name in ("keyframe", "depth", "ids", "motion"))
    made = launch(tmp_path, *words, *size, "seed:=7", "--compose", "--record-topics", topics)
    (tmp_path / "launched.mcap").rename(bag)
    with evis.Simulation("replay", bag=bag, regenerate=True) as sim:
        steps = [sim.reset()]
        while not steps[-1].over:
            steps.append(sim.step())
        assert columns(step for step in [*steps, sim.finish()] if step.events is not None) == made


def test_samples_of_pixels_apart_are_no_pixels_of_an_interpolator_that_averages_none(tmp_path: Path) -> None:
    """Keyframes of rigid are twice as wide and high then, and with another method the events were of such a sensor."""
    bag = tmp_path / "keyframes.mcap"
    size = [f"{key}:={value}" for key, value in SIZE.items()]
    topics = ",".join(f"/cam0/{name}" for name in ("keyframe", "depth", "ids", "motion"))
    words = ("spinning_disk", "supersampling:=2", "upsampling:=2", *size, "--compose", "--record-topics", topics)
    made = launch(tmp_path, *words)
    (tmp_path / "launched.mcap").rename(bag)
    for other in ({"interpolator": "splat"}, {"interpolator": "none"}, {"upsampling": 1}):
        with pytest.raises(evis.SimulationError, match=r"/cam0/keyframe of .* has 2x2 samples of each pixel apart"):
            evis.Simulation("replay", bag=bag, regenerate=True, **other)
    evis.Simulation("replay", bag=bag).close()
    with evis.Simulation("replay", bag=bag, regenerate=True) as sim:
        steps = [sim.reset()]
        while not steps[-1].over:
            steps.append(sim.step())
        assert columns(step for step in steps if step.events is not None) == made


def test_a_launch_file_says_which_seed_it_has(tmp_path: Path) -> None:
    """Where nobody gives one, also to environments with arguments of their own."""
    graph = tmp_path / "seven.yaml"
    graph.write_text("args: {scene: {default: spinning_disk}, seed: {default: 7}}\ninclude: simulator\n")
    with evis.Simulation("spinning_disk", seed=7, shot_rate=20.0, **SIZE) as sim:
        want = columns(sim.run(0.1))
    with evis.Simulation(graph, shot_rate=20.0, **SIZE) as sim:
        assert columns(sim.run(0.1)) == want
        sim.reset(seed=2)
        assert columns([sim.reset(), *sim.run(0.1)]) == want
    with evis.Simulation(graph, shot_rate=20.0, each=[{"omega": 50.0}, {"omega": 20.0}], **SIZE) as sim:
        assert columns(sim.alone(step, 0) for step in sim.run(0.1)) == want
