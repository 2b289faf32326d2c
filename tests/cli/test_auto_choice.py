"""interpolator:=auto and upsampling:=auto on the command line: what is in their place, kept, and left to the user."""

import hashlib
import json

import pytest

from evis.bag.reader import BagReader
from evis.launch.expand import NodeSpec
from nodes.interpolator.auto.cache import fingerprint
from nodes.interpolator.auto.launch import setting_of

SMALL = ("width:=48", "height:=36", "--duration", "0.05", "--no-view", "--json", "--compose")
AUTO = ("interpolator:=auto", "keyframe_rate:=100", "upsampling:=4")
TAKEN = ("interpolator", "keyframe_rate", "upsampling")


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """Where what was measured is kept."""
    return str(tmp_path_factory.mktemp("cache"))


def settings(interpolator=None, **changes):
    renderer = {"scene": "spinning_disk", "scene_args": "omega=50", "width": 32, "height": 24, "device": "cpu",
                "envs": 1, "threads": 1, "margin": 0} | changes  # fmt: skip
    nodes = [NodeSpec("r", "renderer", "x:1", renderer), NodeSpec("s", "event_sensor", "x:2", {"preset": "ideal"})]
    nodes += [NodeSpec("i", "interpolator", "x:3", interpolator)] if interpolator else []
    return setting_of(nodes, 0.05, {"keyframe_rate": None, "upsampling": None})


def test_what_was_measured_is_known_by_all_that_it_depends_on():
    own = fingerprint(settings())
    assert fingerprint(settings()) == own
    for change in (
        {"scene_args": "omega=49"},
        {"width": 33},
        {"margin": 1},
        {"scene": "falling_objects", "scene_args": ""},
        {"interpolator": {"tolerance": 0.05}},
    ):
        assert fingerprint(settings(**change)) != own, change


def test_what_was_measured_is_kept_for_every_wish(evis_here, cache, monkeypatch):
    """Measured once and known from then on, whatever is wanted; what the user gives stays; the reason is true."""
    monkeypatch.setenv("XDG_CACHE_HOME", cache)
    plans = []
    for wish in ((), (), ("wanted_rtf:=0.001",), ("wanted_error:=1e-6",), ("wanted_rtf:=1e6", "wanted_error:=0.9")):
        done = evis_here("launch", "spinning_disk", *AUTO, *wish, *SMALL, "--explain")
        assert done.code == 0, done.err
        plans.append(json.loads(done.out))
    chosen = [plan["chosen"] for plan in plans]
    assert [c["from_cache"] for c in chosen] == [False, True, True, True, True]
    assert chosen[0] | {"from_cache": True} == chosen[1] and plans[0]["args"] == plans[1]["args"]
    assert all((c["keyframe_rate"], c["upsampling"]) == (100, 4) for c in chosen)
    assert all(c["interpolator"] in ("none", "splat", "rigid") for c in chosen)
    # Of the three ways, one that was measured to cost no less than dense rendering of the same frames is left out.
    assert len({c["candidates"] for c in chosen}) == 1 and chosen[0]["candidates"] in (1, 2, 3)
    assert all(
        {key: plan["args"][key] for key in TAKEN} == {key: plan["chosen"][key] for key in TAKEN} for plan in plans
    )
    # All candidates have the frames per second that were given.
    assert chosen[0]["why"].endswith("the least found at 400 frames per second") and "wish_kept" not in chosen[0]
    assert "0.001" in chosen[2]["why"] and chosen[2]["wish_kept"]
    assert "1e-06" in chosen[3]["why"] and not chosen[3]["wish_kept"]
    assert "1e+06" in chosen[4]["why"] and not chosen[4]["wish_kept"]
    assert all(c["why"] in c["summary"] and f"{c['expected_error']:.3g} of 1" in c["summary"] for c in chosen)


@pytest.mark.slow
def test_a_run_is_repeated_bit_for_bit_with_what_was_chosen(evis, cache, tmp_path):
    """Chosen by measuring, and the same given by hand: the same events, and the choice is in the bag."""
    words, results, events = [*AUTO, "wanted_rtf:=0.001"], [], []
    for n in range(2):
        bag = tmp_path / f"{n}.mcap"
        done = evis("launch", "spinning_disk", *words, *SMALL, "--record", str(bag), XDG_CACHE_HOME=cache)
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
        taken = {key: str(args[key]) for key in TAKEN}
        assert {key: metadata[f"arg.{key}"] for key in taken} == taken
        words = [f"{key}:={value}" for key, value in taken.items()]
    first, fixed = results
    assert first["args"]["interpolator"] == first["chosen"]["interpolator"] in ("none", "splat", "rigid")
    assert "chosen" not in fixed and first["args"] == fixed["args"] | {"wanted_rtf": 0.001}
    assert first["events"] > 0 and events[0] == events[1]


def test_the_number_of_frames_alone_is_chosen_for_a_method_that_is_given(evis_here, cache, monkeypatch):
    """Of splat's own candidates, at the rate that holds without auto; whatever dense rendering would do."""
    monkeypatch.setenv("XDG_CACHE_HOME", cache)
    words = ("interpolator:=splat", "upsampling:=auto", "keyframe_rate:=200")
    done = evis_here("launch", "spinning_disk", *words, *SMALL, "--explain")
    assert done.code == 0, done.err
    plan = json.loads(done.out)
    assert (plan["args"]["interpolator"], plan["args"]["keyframe_rate"]) == ("splat", 200)
    assert plan["args"]["upsampling"] == plan["chosen"]["upsampling"] in range(2, 21)
    # At 200 keyframes per second x 2 to x 16, and between every two of them three more.
    assert 4 <= plan["chosen"]["candidates"] <= 16


@pytest.mark.parametrize(("rate", "frames"), [(30, 8), (62.5, 4), (125, 2), (1000, 2), (10, 25)])
def test_beside_single_pixels_250_frames_per_second_do(evis_here, rate, frames):
    words = ("upsampling:=auto", "time_tolerance:=0.0001", f"keyframe_rate:={rate}")
    done = evis_here("launch", "spinning_disk", *words, *SMALL, "--explain")
    assert done.code == 0, done.err
    plan = json.loads(done.out)
    assert plan["args"]["upsampling"] == frames and "by samples between them" in plan["chosen"]["why"]


@pytest.mark.parametrize(
    ("asked", "frames"),
    # Light by paths goes by frames alone, of which fewer would be worse.
    [
        ((), 4),
        (("upsampling:=6",), 6),
        (("supersampling:=2",), 4),
        (("defocus:=1",), 8),
        (("image:=true",), 8),
        (("keyframe_rate:=10",), 12),
    ],
)
def test_a_tolerance_of_time_decides_k_unless_it_is_given(evis_here, asked, frames):
    done = evis_here("launch", "spinning_disk", "time_tolerance:=0.0003", *asked, *SMALL, "--explain")
    assert done.code == 0, done.err
    assert json.loads(done.out)["args"]["upsampling"] == frames


@pytest.mark.parametrize(
    ("asked", "text"),
    [
        (("time_tolerance:=0.004",), "by samples between them"),  # frames are 8.3 ms apart
        (("time_tolerance:=0.005",), "there are no samples between them"),
        (("time_tolerance:=0.0003", "supersampling:=2"), "by samples between them"),
        (("time_tolerance:=0.0003", "crossing:=cubic"), "by which all pixels go"),
    ],
)
def test_it_is_said_where_frames_are_all_there_is(evis_here, asked, text):
    done = evis_here("launch", "spinning_disk", *asked, *SMALL, "--explain")
    assert done.code == 0, done.err
    assert text in json.loads(done.out)["chosen"]["why"]


@pytest.mark.parametrize("words,text", [
    (("wanted_error:=0.1",), "wanted_error is for interpolator:=auto"),
    (("upsampling:=auto", "wanted_rtf:=1", "time_tolerance:=1e-4"), "it is this that decides the error"),
    (("interpolator:=auto", "time_tolerance:=1e-4"), "write interpolator:=rigid"),
    (("interpolator:=splat", "upsampling:=auto", "time_tolerance:=1e-4"), "rigid alone, and this is splat"),
    (("upsampling:=most",), "must be a whole number or auto"),
    (("interpolator:=auto", "wanted_rtf:=-1"), "wanted_rtf"),
    (("interpolator:=auto", "cameras:=cam7"), "no camera 'cam7'"),
])  # fmt: skip
def test_a_wish_that_cannot_be_is_one_line(evis_here, words, text):
    done = evis_here("launch", "spinning_disk", *words, *SMALL)
    assert done.code != 0 and text in done.line
