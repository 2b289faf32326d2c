"""`evis bag export BAG --layout`: the same sequence as from the simulation itself."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sequences import EVERY, written

import evis
from evis.bag import BagError
from evis.bag.reader import BagReader
from evis.bag.writer import BagWriter
from evis.cli import main
from evis.dataset.about import About
from evis.dataset.bag_sequence import export
from evis.dataset.layouts import reader_of
from evis.simulation.step import Step
from msgs.camera import Image
from msgs.header import Header

OUTPUTS = ["events", "info", "labels.boxes", "labels.depth", "labels.segmentation", "labels.forward_flow"]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: Any) -> tuple[Path, About, tuple[Any, ...]]:
    """A bag, and the steps that it was recorded from. Its preview, which was not exposed, is no frame."""
    bag = tmp_path_factory.mktemp("bag") / "a.mcap"
    with evis.Simulation("spinning_disk", outputs=OUTPUTS, seed=2, width=64, height=48) as sim:
        steps = [sim.reset(), *(sim.step() for _ in range(3))]
    with BagWriter(bag, {"evis": {"seed": "2", "arg.scene": "spinning_disk"}}) as writer:
        writer.write("/cam0/info", steps[0].info)
        for step in steps:
            writer.write("/cam0/image", Image(Header(step.stamp_ns), np.zeros((48, 64, 3), np.uint8)))
            writer.write("/cam0/events", step.events)
            writer.write("/cam0/labels", step.labels)
    cameras = {"cam0": steps[0].cameras["cam0"].info}
    return bag, About("a", "spinning_disk", {}, 2, 100_000_000, 30.0, cameras, ()), tuple(steps)


@pytest.mark.parametrize("layout", EVERY)
def test_a_bag_in_every_layout(recorded: Any, layout: str, tmp_path: Path, capsys: Any) -> None:
    """Events and labels are those of the steps, array by array."""
    bag, about, steps = recorded
    assert main(["bag", "export", str(bag), "--layout", layout, str(tmp_path / "b"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    written(layout, tmp_path / "s", about, steps)
    got, want = (reader_of(layout)(tmp_path / name) for name in "bs")
    assert told["events"] == got.count == want.count > 1000 and told["layout"] == layout
    assert all(np.array_equal(a, b) for a, b in zip(got.events(0, 10**12), want.events(0, 10**12)))
    assert got.kinds("cam0") == want.kinds("cam0") and got.kinds("cam0")
    for kind in got.kinds("cam0"):
        mine, theirs = (reader.labels(kind, 0, 10**12) for reader in (got, want))
        assert mine.keys() == theirs.keys()
        assert all(mine[name].tobytes() == theirs[name].tobytes() for name in mine), kind
    assert got.about.seed == 2 and got.about.duration_ns == 100_000_000


@pytest.mark.parametrize("layout", ["npz", "webdataset", "mcap", "dsec"])
def test_images_between_keyframes_hide_no_events(recorded: Any, layout: str, tmp_path: Path) -> None:
    """Of an interval that ends between an image and the packet that follows it."""
    steps = recorded[2]
    bag = tmp_path / "images.mcap"
    with BagWriter(bag, {"evis": {}}) as writer:
        writer.write("/cam0/info", steps[0].info)
        for before, step in zip((None, *steps), steps):
            for stamp in range(before.stamp_ns + 8_000_000, step.stamp_ns, 8_000_000) if before else ():
                writer.write("/cam0/image", Image(Header(stamp), np.zeros((48, 64, 1), np.uint8), "mono8", 1_000_000))
            writer.write("/cam0/events", step.events)
    export(str(bag), layout, str(tmp_path / "s"))
    reader = reader_of(layout)(tmp_path / "s")
    t = np.concatenate([step.events.t for step in steps])
    t = t // 1000 * 1000 if layout == "dsec" else t
    for end in range(1_000_000, 100_000_000, 5_000_000):
        assert np.array_equal(reader.events(0, end).t, t[t < end])


@pytest.mark.parametrize("layout", EVERY)
def test_a_sequence_without_events_is_read(recorded: Any, layout: str, tmp_path: Path) -> None:
    """As one of images or labels alone is."""
    _, about, steps = recorded
    bare = [{name: value for name, value in vars(s.cameras["cam0"]).items() if name != "events"} for s in steps]
    copies = [Step(s.stamp_ns, s.episodes, {"cam0": own}, {}, s.over) for s, own in zip(steps, bare)]
    written(layout, tmp_path / "s", about, tuple(copies))
    reader = reader_of(layout)(tmp_path / "s")
    assert reader.count == 0 and len(reader.events(0, 10**9).t) == 0 and reader.kinds("cam0")


def test_what_cannot_be_written_is_said(recorded: Any, tmp_path: Path, capsys: Any) -> None:
    """A folder that is not empty, an unknown layout, both of topic and layout."""
    bag = str(recorded[0])
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "x").touch()
    assert main(["bag", "export", bag, "--layout", "npz", str(tmp_path / "full")]) == 1
    assert "is not empty; a sequence goes into a folder of its own" in capsys.readouterr().err
    for words in (["--layout", "dsek"], ["--layout", "npz", "--topic", "/a"], ["--topic", "/a", "--env", "1"], []):
        assert main(["bag", "export", bag, *words, str(tmp_path / "o")]) == 2
        assert "--layout" in capsys.readouterr().err and not (tmp_path / "o").exists()


def test_a_bag_that_ends_before_its_cameras_are_described_is_told_so(recorded: Any, tmp_path: Path) -> None:
    """Its topics are there already, which stand before the first chunk of messages."""
    with BagReader(recorded[0]) as reader:
        first = reader.scanner.layout.chunks[0]
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(recorded[0].read_bytes()[: first.at + 40])
    with pytest.raises(BagError, match=r"torn.mcap ends before /cam0/info, .* \(it ends within the record at byte"):
        export(torn, "npz", tmp_path / "out")
    torn.write_bytes(recorded[0].read_bytes()[:60])
    with pytest.raises(BagError, match=r"torn.mcap is torn \(it ends within the record at byte"):
        export(torn, "npz", tmp_path / "out")


def test_a_bag_whose_events_cannot_be_read_is_told_so(recorded: Any, tmp_path: Path) -> None:
    """Of its two chunks the one with every packet of events is damaged."""
    bag, steps = tmp_path / "damaged.mcap", recorded[2]
    noise = np.random.default_rng(0).integers(0, 256, (1200, 1600, 3)).astype(np.uint8)
    with BagWriter(bag, {}) as writer:
        writer.write("/cam0/info", steps[0].info)
        writer.write("/cam0/image", Image(Header(0), noise))  # which ends the first chunk
        for step in steps:
            writer.write("/cam0/events", step.events)
    with BagReader(bag) as reader:
        chunks = reader.scanner.layout.chunks
        events = {i for i, stream in reader.streams.items() if stream.topic == "/cam0/events"}
    assert [bool(events & chunk.channels) for chunk in chunks] == [False, True]
    data = bytearray(bag.read_bytes())
    data[chunks[1].at + chunks[1].size // 2] ^= 0xFF
    bag.write_bytes(data)
    with pytest.raises(BagError, match=r"damaged.mcap has no packet of /cam0/events that can be read \(.*; record it"):
        export(bag, "npz", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("kind", ["file", "dangling"])
def test_a_file_in_place_of_the_folder_stays(recorded: Any, kind: str, tmp_path: Path, capsys: Any) -> None:
    """And a link that leads nowhere: it is refused in one line, with nothing written behind it."""
    out = tmp_path / "mine.txt"
    out.write_text("mine") if kind == "file" else out.symlink_to(tmp_path / "elsewhere")
    assert main(["bag", "export", str(recorded[0]), "--layout", "npz", str(out)]) == 1
    told = f"evis bag: {out} is there and is no folder; a sequence goes into a folder of its own\n"
    assert capsys.readouterr().err == told
    assert out.read_text() == "mine" if kind == "file" else out.is_symlink()
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_an_environment_that_is_not_there_is_refused(recorded: Any, tmp_path: Path, capsys: Any) -> None:
    """Of a bag of one environment too, whose events stood for those of any number; 0 is the one."""
    words = ["bag", "export", str(recorded[0]), "--layout", "npz"]
    for wrong in ("3", "-1"):
        assert main([*words, str(tmp_path / "a"), "--env", wrong]) == 1
        assert f"has no environment {wrong}; it has 0 alone" in capsys.readouterr().err
        assert not (tmp_path / "a").exists()
    assert main([*words, str(tmp_path / "b"), "--env", "0"]) == 0


def test_one_of_several_environments(tmp_path: Path, capsys: Any) -> None:
    """It is asked for by number, and its events and what is told of it are those of a run with its own seed."""
    with evis.Simulation("spinning_disk", outputs=["events", "info"], seed=5, envs=2, width=32, height=24) as sim:
        sim.run(0.07)
        sim.save(tmp_path / "a.mcap")
    assert main(["bag", "export", str(tmp_path / "a.mcap"), "--layout", "npz", str(tmp_path / "b")]) == 1
    assert "has 2 environments; name one of them: --env 0" in capsys.readouterr().err
    assert main(["bag", "export", str(tmp_path / "a.mcap"), "--layout", "npz", "--env", "1", str(tmp_path / "c")]) == 0
    with evis.Simulation("spinning_disk", seed=6, width=32, height=24) as sim:
        want = np.concatenate([step.events.t for step in sim.run(0.07) if step.events is not None])
        sim.save(tmp_path / "a.mcap")
    assert np.array_equal(reader_of("npz")(tmp_path / "c").events(0, 10**12).t, want) and len(want) > 100
    assert main(["bag", "export", str(tmp_path / "a.mcap"), "--layout", "npz", str(tmp_path / "d")]) == 0
    assert (tmp_path / "c" / "about.json").read_text() == (tmp_path / "d" / "about.json").read_text()
    assert reader_of("npz")(tmp_path / "d").about.seed == 6


def test_what_a_bag_draws_for_an_environment(tmp_path: Path) -> None:
    """Is told of that environment alone, as of a run with its own seed."""
    told = []
    for name, envs, seed in (("a", 2, 3), ("b", 1, 4)):
        words = {"vary": 1, "envs": envs, "seed": seed, "width": 32, "height": 24}
        with evis.Simulation("falling_objects", outputs=["events", "info"], **words) as sim:
            sim.run(0.04)
            sim.save(tmp_path / f"{name}.mcap")
        export(tmp_path / f"{name}.mcap", "npz", tmp_path / name, env=envs - 1)
        told.append(About.load(tmp_path / name).cameras["cam0"])
    assert told[0].drawn == told[1].drawn and told[0].drawn
    assert told[0].sensor == told[1].sensor and told[0].envs == 1


def test_what_a_layout_does_not_get_is_said(recorded: Any, tmp_path: Path, capsys: Any) -> None:
    """Of a bag that ends early, and of images without an exposure that others made."""
    (tmp_path / "torn.mcap").write_bytes(recorded[0].read_bytes()[:-40])
    assert main(["bag", "export", str(tmp_path / "torn.mcap"), "--layout", "npz", str(tmp_path / "a")]) == 0
    assert "torn.mcap is torn" in capsys.readouterr().err
    header = Header(10_000_000, 0, "ros")
    with BagWriter(tmp_path / "b.mcap", {}) as writer:
        writer.write("/cam0/info", recorded[2][0].info)
        writer.write("/cam0/image", Image(header, np.zeros((48, 64, 1), np.uint8), "mono8"))
        for step in recorded[2][1:]:
            writer.write("/cam0/events", step.events)
    assert main(["bag", "export", str(tmp_path / "b.mcap"), "--layout", "npz", str(tmp_path / "b")]) == 0
    assert "images on /cam0/image are left out: no exposure is told" in capsys.readouterr().err


@pytest.mark.parametrize("camera", ["../../other", "{place}/other"])
@pytest.mark.parametrize("layout", ["npz", "coco"])
def test_a_bag_names_no_folder_outside(recorded: Any, camera: str, layout: str, tmp_path: Path) -> None:
    """Its cameras are what its topics say, and their files lie in folders of these names."""
    path, out = tmp_path / "b.mcap", tmp_path / "a" / "b" / "s"
    with BagReader(recorded[0]) as reader, BagWriter(path) as writer:
        for topic, message in reader.messages(["/cam0/events", "/cam0/info"]):
            writer.write(f"/{camera.format(place=tmp_path)}/{topic.rpartition('/')[2]}", message)
    with pytest.raises(ValueError, match="leads out of its folder"):
        export(path, layout, out)
    assert [p.name for p in tmp_path.iterdir()] == ["b.mcap"]
