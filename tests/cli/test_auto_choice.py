"""interpolator:=auto on the command line: what it puts in its place, keeps, and leaves to the user."""

import hashlib
import json

import pytest

from evis.bag.reader import BagReader
from evis.cli.auto import fingerprint, setting_of
from evis.launch.expand import NodeSpec

SMALL = ("width:=48", "height:=36", "--duration", "0.05", "--no-view", "--json", "--compose")


def settings(**changes):
    renderer = {"scene": "spinning_disk", "scene_args": "omega=50", "width": 32, "height": 24, "device": "cpu",
                "envs": 1, "threads": 1, "margin": 0} | changes  # fmt: skip
    nodes = [NodeSpec("r", "renderer", "x:1", renderer), NodeSpec("s", "event_sensor", "x:2", {"preset": "ideal"})]
    return setting_of(nodes, 0.05, {"keyframe_rate": None, "upsampling": None})


def test_what_was_measured_is_known_by_all_that_it_depends_on():
    own = fingerprint(settings())
    assert fingerprint(settings()) == own
    for change in (
        {"scene_args": "omega=49"},
        {"width": 33},
        {"margin": 1},
        {"scene": "falling_objects", "scene_args": ""},
    ):
        assert fingerprint(settings(**change)) != own, change


def test_a_run_is_repeated_bit_for_bit_with_what_was_chosen(evis, tmp_path):
    """Measured once, known the second time, and given by hand the third: the same events. What the user gives stays."""
    cache = {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    results, events = [], []
    words = ["interpolator:=auto", "keyframe_rate:=100", "upsampling:=4", "wanted_rtf:=0.001"]
    for n in range(3):
        bag = tmp_path / f"{n}.mcap"
        done = evis("launch", "spinning_disk", *words, *SMALL, "--record", str(bag), **cache)
        assert done.code == 0, done.err
        results.append(json.loads(done.out))
        with BagReader(str(bag)) as reader:
            data = hashlib.sha256()
            for _, message in reader.messages(["/cam0/events"]):
                for name in "txyp":
                    data.update(getattr(message, name).tobytes())
            events.append(data.hexdigest())
            metadata = reader.metadata["evis"]
        args = results[-1]["args"]
        taken = {key: str(args[key]) for key in ("interpolator", "keyframe_rate", "upsampling")}
        assert {key: metadata[f"arg.{key}"] for key in taken} == taken
        if n == 1:
            words = [f"{key}:={value}" for key, value in taken.items()]
    first, again, fixed = results
    chosen = first["chosen"]
    assert chosen["why"] and first["args"]["interpolator"] == chosen["interpolator"] in ("none", "splat", "rigid")
    assert (chosen["keyframe_rate"], chosen["upsampling"]) == (100, 4) and "0.001" in chosen["why"]
    assert not chosen["from cache"] and again["chosen"]["from cache"] and "chosen" not in fixed
    assert first["args"] == again["args"] == fixed["args"] | {"wanted_rtf": 0.001} and first["events"] > 0
    assert events[0] == events[1] == events[2]


@pytest.mark.parametrize("words,text", [
    (("wanted_error:=0.1",), "wanted_error is for interpolator:=auto"),
    (("interpolator:=auto", "wanted_rtf:=-1"), "wanted_rtf"),
    (("interpolator:=auto", "cameras:=cam7"), "no camera 'cam7'"),
])  # fmt: skip
def test_a_wish_that_cannot_be_is_one_line(evis, words, text):
    done = evis("launch", "spinning_disk", *words, *SMALL)
    assert done.code != 0 and text in done.line
