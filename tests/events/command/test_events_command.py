"""`evis events` on files."""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time

import h5py
import numpy as np
import pytest
from stream_cases import random_events, same, sha256_us

from evis.cli import events as command
from evis.cli.parser import UsageError
from evis.events import Events, Triggers, open_recording, open_writer


def parse(*arguments: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="evis events")
    command.add_arguments(parser)
    return parser.parse_args([str(a) for a in arguments])


def call(capsys, *arguments) -> dict:
    assert command.run(parse(*arguments, "--json")) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("name", ["derived/gen31_vga_from_bag1.raw", "prophesee/faery_evt2.raw"])
def test_info_of_real_recordings(name, capsys, truth, recording_path):
    """Counts and times as other readers found them, in ns, not shifted."""
    known = truth[name]
    info = call(capsys, "info", recording_path(name))
    assert info["events"] == known["n"] and info["on"] == known["n_on"] and info["off"] == known["n"] - known["n_on"]
    assert info["t_first_ns"] == known["first"][0] * 1000 and info["t_last_ns"] == known["last"][0] * 1000
    assert (info["width"], info["height"], info["format"]) == (640, 480, "raw")
    assert info["encoding"] == ("evt2" if "faery" in name else "evt3")


def test_convert_chain_keeps_every_event(capsys, tmp_path, truth, recording_path):
    """RAW -> npz -> RAW EVT2 -> RAW EVT3: the hash stays that of other readers."""
    name = "derived/gen31_vga_from_bag1.raw"
    at = recording_path(name)
    for out, options in (("a.npz", []), ("b.raw", ["--encoding", "evt2"]), ("c.raw", [])):
        result = call(capsys, "convert", at, tmp_path / out, *options)
        assert result["events"] == truth[name]["n"]
        at = tmp_path / out
    with open_recording(at) as recording:
        assert recording.info.encoding == "evt3"
        assert sha256_us(recording.read()) == truth[name]["sha256"]


@pytest.mark.parametrize("suffix", [".dat", ".es", ".aedat4", ".h5", ".npz", ".txt", ".csv"])
def test_convert_through_every_format_that_is_written(suffix, capsys, tmp_path, truth, recording_path):
    """EVT2.1 -> the format -> EVT3: the hash stays that of other readers."""
    name = "derived/hd_from_evt3_sample_evt21_little.raw"
    source = recording_path(name)
    with open_recording(source) as recording:
        steps_back = bool((np.diff(recording.read().t) < 0).any())
    if steps_back and suffix == ".es":
        with pytest.raises(ValueError, match="step back"):
            command.run(parse("convert", source, tmp_path / "a.es"))
        return
    assert call(capsys, "convert", source, tmp_path / f"a{suffix}")["events"] == truth[name]["n"]
    call(capsys, "convert", tmp_path / f"a{suffix}", tmp_path / "b.raw", "--encoding", "evt3")
    with open_recording(tmp_path / "b.raw") as recording:
        assert sha256_us(recording.read()) == truth[name]["sha256"]


def test_convert_keeps_frames_and_imu_or_says_so(capsys, tmp_path, recording_path):
    """A DAVIS recording into AEDAT 4, with times from 0, and into RAW."""
    source = recording_path("aedat4/aestream_davis.aedat4")
    result = call(capsys, "convert", source, tmp_path / "a.aedat4", "--rebase")
    assert (result["events"], result["triggers"], result["imu"], result["frames"]) == (117667, 15, 130, 3)
    info = call(capsys, "info", tmp_path / "a.aedat4")
    assert (info["triggers"], info["imu_samples"], info["frames"]) == (15, 130, 3)
    assert info["t_last_ns"] - info["t_first_ns"] == 129_999_000
    result = call(capsys, "convert", tmp_path / "a.aedat4", tmp_path / "a.raw")
    assert (result["triggers"], result["imu_left_out"], result["frames_left_out"]) == (15, 130, 3)


def test_topic_and_size_on_the_command_line(capsys, tmp_path, recording_path):
    """A size is taken and told; one that is none is wrong usage; an unknown topic is an error with the right ones."""
    source = recording_path("prophesee/faery_evt2.raw")
    info = call(capsys, "info", source, "--size", "640x100")
    assert (info["height"], info["geometry_from"]) == (100, "option") and info["events_outside"] > 0
    with pytest.raises(SystemExit) as end:
        parse("info", source, "--size", "big")
    assert end.value.code == 2
    with pytest.raises(ValueError, match="no events on '/x'; they are on /event_camera/events"):
        command.run(parse("info", recording_path("ros/event_camera_py_test_events_1.bag"), "--topic", "/x"))


def test_convert_tells_what_is_lost(capsys, tmp_path):
    """Times below a us in RAW, triggers in .npz, colour in all but .npz."""
    with open_writer(tmp_path / "a.npz", 9, 9) as writer:
        writer.write(Events.of([1000, 2001, 3999], [1, 2, 3], [1, 2, 3], [0, 1, 0]))
    assert call(capsys, "convert", tmp_path / "a.npz", tmp_path / "a.raw")["times_rounded_to_us"] == 2
    with open_recording(tmp_path / "a.raw") as recording:
        assert recording.read().t.tolist() == [1000, 2000, 3000]
    events = random_events(1, 50)
    events.triggers = Triggers(np.array([5000]), np.ones(1, np.uint8), np.ones(1, np.uint8))
    with open_writer(tmp_path / "b.raw", 640, 480) as writer:
        writer.write(events)
    assert call(capsys, "convert", tmp_path / "b.raw", tmp_path / "b.npz")["triggers_left_out"] == 1
    assert call(capsys, "convert", tmp_path / "b.raw", tmp_path / "c.raw")["triggers"] == 1
    with open_writer(tmp_path / "c.npz", 9, 9) as writer:
        writer.write(Events.of([1000, 2000, 3000], [1, 2, 3], [1, 2, 3], [0, 1, 0], [0, 1, 2]))
    for out in ("d.csv", "d.txt", "d.dat", "d.es", "d.aedat4", "d.h5"):
        assert call(capsys, "convert", tmp_path / "c.npz", tmp_path / out)["colour_left_out"] == 3
    assert "colour_left_out" not in call(capsys, "convert", tmp_path / "c.npz", tmp_path / "d.npz")


def test_times_that_count_from_1970_need_rebase(capsys, tmp_path):
    """RAW counts from 0: refused with the remedy, then done on request."""
    t = 1_633_953_690_975_950_000 + np.array([0, 1_000_000, 5_000_000])
    with open_writer(tmp_path / "a.npz", 9, 9) as writer:
        writer.write(Events.of(t, [1, 2, 3], [1, 2, 3], [0, 1, 0]))
    with pytest.raises(ValueError, match="--rebase"):
        command.run(parse("convert", tmp_path / "a.npz", tmp_path / "a.raw"))
    assert not (tmp_path / "a.raw").exists()
    call(capsys, "convert", tmp_path / "a.npz", tmp_path / "a.raw", "--rebase")
    with open_recording(tmp_path / "a.raw") as recording:
        assert recording.read().t.tolist() == [0, 1_000_000, 5_000_000]


def test_convert_onto_itself(capsys, tmp_path):
    """The output takes its name only when it is complete."""
    events = random_events(8, 400)
    with open_writer(tmp_path / "a.raw", 640, 480, "evt2") as writer:
        writer.write(events)
    call(capsys, "convert", tmp_path / "a.raw", tmp_path / "a.raw")
    with open_recording(tmp_path / "a.raw") as recording:
        assert recording.info.encoding == "evt3"
        same(recording.read(), events)


def test_render(capsys, tmp_path):
    """Animation and sheet: the pixels of events, in the right places, on white."""
    from PIL import Image

    t = np.array([0, 1, 25, 45]) * 1_000_000
    with open_writer(tmp_path / "a.npz", 40, 30) as writer:
        writer.write(Events.of(t, [1, 39, 5, 6], [2, 29, 5, 6], [1, 0, 1, 0]))
    assert call(capsys, "render", tmp_path / "a.npz", tmp_path / "a.gif")["pictures"] == 3
    with Image.open(tmp_path / "a.gif") as gif:
        assert (gif.size, gif.n_frames) == ((40, 30), 3)
    assert call(capsys, "render", tmp_path / "a.npz", tmp_path / "a.png", "--to", "0.02")["pictures"] == 1
    with Image.open(tmp_path / "a.png") as png:
        picture = np.asarray(png.convert("RGB"))
    marked = np.argwhere((picture != 255).any(2)).tolist()
    assert marked == [[2, 1], [29, 39]]
    assert picture[2, 1, 2] > picture[2, 1, 0] and picture[29, 39, 0] > picture[29, 39, 2]
    assert call(capsys, "render", tmp_path / "a.npz", tmp_path / "b.png")["pictures"] == 3
    with Image.open(tmp_path / "b.png") as png:
        assert png.size == (3 * 44 - 4, 30)


def test_render_mp4_gives_ffmpeg_every_pixel(capsys, tmp_path, monkeypatch):
    """A stand-in for the program counts the bytes; without it there is one clear line."""
    with open_writer(tmp_path / "a.npz", 40, 30) as writer:
        writer.write(Events.of([0, 50_000_000], [1, 2], [1, 2], [1, 1]))
    monkeypatch.setenv("PATH", str(tmp_path))
    with monkeypatch.context() as bare:
        bare.setitem(sys.modules, "av", None)
        with pytest.raises(ValueError, match=r"needs the program ffmpeg or .*video"):
            command.run(parse("render", tmp_path / "a.npz", tmp_path / "a.mp4"))
    stand_in = tmp_path / "ffmpeg"
    kept = "open(sys.argv[-1].removeprefix('file:'), 'wb').write(sys.stdin.buffer.read())"
    stand_in.write_text(f"#!{sys.executable}\nimport sys\n{kept}\n")
    stand_in.chmod(0o755)
    assert call(capsys, "render", tmp_path / "a.npz", tmp_path / "a.mp4")["pictures"] == 3
    assert (tmp_path / "a.mp4").stat().st_size == 3 * 40 * 30 * 3
    stand_in.write_text(f"#!{sys.executable}\nimport sys\nsys.exit('no such codec')\n")
    with pytest.raises(ValueError, match="no such codec"):
        command.run(parse("render", tmp_path / "a.npz", tmp_path / "a.mp4"))


def test_render_mp4_without_ffmpeg_plays(capsys, tmp_path, monkeypatch):
    """PyAV writes a film of even size, in which each picture shows its event's column of colour; under any name."""
    av = pytest.importorskip("av")
    with open_writer(tmp_path / "a.npz", 41, 31) as writer:
        for k in range(3):
            x = np.full(31, 10 * k + 5)
            writer.write(Events.of(np.full(31, k * 20_000_000), x, np.arange(31), np.ones(31, int)))
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert call(capsys, "render", "a.npz", "12:30.mp4")["pictures"] == 3
    with av.open(f"file:{tmp_path}/12:30.mp4") as film:
        frames = [f.to_ndarray(format="rgb24") for f in film.decode(video=0)]
    assert [f.shape for f in frames] == [(32, 42, 3)] * 3
    assert [int(f[:31, :41].astype(int).sum((0, 2)).argmin()) for f in frames] == [5, 15, 25]


def test_simulate_never_writes_over_its_frames(tmp_path):
    path = tmp_path / "f.npz"
    np.savez(path, luminance=np.ones((3, 4, 5), np.float32), t=np.arange(3) * 1_000_000)
    before = path.read_bytes()
    (tmp_path / "link.npz").symlink_to(path)
    for out in (path, tmp_path / "link.npz"):
        with pytest.raises(UsageError, match="holds the frames and would be lost"):
            command.run(parse("simulate", path, out))
    assert path.read_bytes() == before


@pytest.mark.parametrize("option", [("--threshold", "-0.2"), ("--leak-rate", "nan"), ("--crossing", "circle")])
def test_simulate_option_out_of_range_is_wrong_usage(tmp_path, option):
    with pytest.raises(UsageError, match=option[0].strip("-").replace("-", "_")):
        command.run(parse("simulate", "f.npz", tmp_path / "a.npz", *option))


def test_simulate_a_brightening_pixel(capsys, tmp_path):
    """ln I goes up by 1 in 10 ms: ten ON events at threshold 0.1, one each ms, by eq. (4) of the method."""
    t = np.arange(11, dtype=np.int64) * 1_000_000
    luminance = np.ones((11, 4, 5), np.float32)
    luminance[:, 1, 2] = np.exp(np.linspace(0, 1.0005, 11))
    np.savez(tmp_path / "f.npz", luminance=luminance, t=t)
    result = call(capsys, "simulate", tmp_path / "f.npz", tmp_path / "e.npz", "--threshold", "0.1")
    assert (result["events"], result["width"], result["height"]) == (10, 5, 4)
    with open_recording(tmp_path / "e.npz") as recording:
        events = recording.read()
    assert set(zip(events.x.tolist(), events.y.tolist(), events.p.tolist())) == {(2, 1, 1)}
    # the crossings lie 0.05 % before the whole milliseconds; float32 luminance moves them by 1e-6 of a step or so
    np.testing.assert_allclose(events.t, np.arange(1, 11) * 1e6 / 1.0005, atol=20)


@pytest.mark.parametrize(
    ("arrays", "text"),
    [
        ({"t": np.arange(3)}, "no array luminance"),
        ({"luminance": np.ones((3, 2, 2), np.float32), "t": np.arange(2)}, r"t is int64 \[2\]"),
        ({"luminance": np.ones((3, 2, 2), np.float32), "t": np.array([0, 2, 1])}, "must go up"),
        ({"luminance": np.ones((3, 2), np.float32), "t": np.arange(3)}, "luminance is float32"),
        ({"luminance": np.ones((3, 2, 2), np.float32), "t": np.linspace(0, 1, 3)}, "t is float64"),
    ],
)
def test_simulate_names_what_is_wrong_with_the_frames(arrays, text, tmp_path):
    """Missing arrays, shapes, order, types."""
    np.savez(tmp_path / "f.npz", **arrays)
    with pytest.raises(ValueError, match=text):
        command.run(parse("simulate", tmp_path / "f.npz", tmp_path / "e.npz"))


def test_help_has_examples(capsys):
    """Each action shows how it is used."""
    for action in command.EXAMPLES:
        with pytest.raises(SystemExit) as end:
            parse(action, "--help")
        assert end.value.code == 0
        assert f"evis events {action}" in capsys.readouterr().out


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_conversion_leaves_nothing(number, tmp_path):
    """However it is ended; the file would take hours."""
    whole = tmp_path / "a.dat"
    whole.write_bytes(b"% Data file containing CD events.\n% Version 2\n% Height 480\n% Width 640\n\x0c\x08")
    os.truncate(whole, 40 << 30)  # takes no room on the disk
    with whole.open("ab") as file:
        file.write(b"\1" * 8)
    done = subprocess.Popen(
        [sys.executable, "-m", "evis", "events", "convert", whole, tmp_path / "a.csv"],
        stderr=subprocess.PIPE,
        text=True,
    )
    limit = time.monotonic() + 60
    while len(list(tmp_path.iterdir())) < 2 and done.poll() is None and time.monotonic() < limit:
        time.sleep(0.01)
    assert len(list(tmp_path.iterdir())) == 2
    done.send_signal(number)
    _, told = done.communicate(timeout=60)
    assert done.returncode == 128 + number and told == "evis events: interrupted\n"
    assert list(tmp_path.iterdir()) == [whole]


@pytest.mark.parametrize(("suffix", "said"), [(".csv", True), (".txt", True), (".dat", False)])
def test_the_size_that_text_has_not(suffix, said, capsys, tmp_path):
    """Is told when it is left out, with the option that gives it back."""
    with open_writer(tmp_path / "a.raw", 640, 480) as writer:
        writer.write(random_events(1, 50))
    result = call(capsys, "convert", tmp_path / "a.raw", tmp_path / f"b{suffix}")
    assert any("say --size 640x480" in w for w in result.get("warnings", [])) == said
    info = call(capsys, "info", tmp_path / f"b{suffix}", "--size", "640x480")
    assert (info["width"], info["height"], info["events"]) == (640, 480, 50)


def test_options_with_the_underscore_of_launch(capsys):
    """`refractory_us` is the parameter's name everywhere else."""
    given = parse("simulate", "a.npz", "b.npz", "--refractory_us", "1", "--hot_pixel_rate=2")
    assert given.refractory_us == "1"
    with pytest.raises(SystemExit):
        parse("simulate", "a.npz", "b.npz", "--refractory_ms", "1")
    assert "no option '--refractory_ms'; did you mean '--refractory-us'?" in capsys.readouterr().err


def test_simulate_tells_of_samples_without_a_logarithm(capsys, tmp_path):
    """Black pixels of an archive are skipped, and what to do about them is said."""
    frames = np.full((4, 6, 8), 0.5, np.float32)
    frames[:, 0] = 0.0
    np.savez(tmp_path / "f.npz", luminance=frames, t=np.arange(4) * 1_000_000)
    result = call(capsys, "simulate", tmp_path / "f.npz", tmp_path / "o.npz")
    assert result["nonfinite"] == 4 * 8 and "try --dark-level" in result["warnings"][0]
    result = call(capsys, "simulate", tmp_path / "f.npz", tmp_path / "o.npz", "--dark_level", "0.01")
    assert "warnings" not in result and "nonfinite" not in result


@pytest.mark.parametrize("ending", ["es", "dat", "raw", "aedat"])
def test_rebase_is_not_advised_to_who_gave_it(capsys, tmp_path, ending):
    """Of events that are not in order the first one may not be the earliest."""
    with open_writer(tmp_path / "a.npz", 9, 9) as writer:
        writer.write(Events.of([5_000_000, 1_000_000], [1, 2], [1, 2], [0, 1]))
    words = ["convert", tmp_path / "a.npz", tmp_path / f"a.{ending}"]
    if ending == "aedat":
        words[2] = tmp_path / "a.es"
        with open_writer(tmp_path / "a.npz", 9, 9) as writer:  # an hour and a half of silence
            writer.write(Events.of([0, 10**17], [1, 2], [1, 2], [0, 1]))
    with pytest.raises(ValueError, match=r"sort the events.*write \.npz") as told:
        command.run(parse(*words, "--rebase"))
    assert "use --rebase" not in str(told.value)


def test_convert_takes_a_part_of_the_events(capsys, tmp_path):
    """Two rows of a bar that moves, a lone event beside it, and one half of the sensor: what is left is counted by
    hand, what is left out is told."""
    x = np.repeat(np.arange(10), 2)
    t, y, p = x * 1_000_000, np.tile([4, 5], 10), np.tile([1, 0], 10)
    rows = sorted([*zip(t.tolist(), x.tolist(), y.tolist(), p.tolist()), (5_000_000, 2, 15, 1)])
    with open_writer(tmp_path / "bar.npz", 20, 16) as out:
        out.write(Events.of(*zip(*rows)))
    part = ["--crop", "5,4,6,3", "--polarity", "on", "--denoise", "2"]
    told = call(capsys, "convert", tmp_path / "bar.npz", tmp_path / "part.npz", *part)
    # lone: the very first event and the one at (2, 15); outside: the rest of columns 0 to 4; OFF: row 5
    assert {k: told[k] for k in ("events", "noise_left_out", "outside_crop", "off_left_out")} == {
        "events": 5, "noise_left_out": 2, "outside_crop": 9, "off_left_out": 5,
    }  # fmt: skip
    with open_recording(tmp_path / "part.npz") as recording:
        assert (recording.info.width, recording.info.height) == (6, 3)
        events = recording.read()
    assert (events.x.tolist(), set(events.y), set(events.p)) == ([0, 1, 2, 3, 4], {0}, {1})
    assert events.t.tolist() == [k * 1_000_000 for k in range(5, 10)]


@pytest.mark.parametrize(
    ("option", "said"),
    [
        (["--crop", "18,0,3,3"], "--crop 18,0,3,3 is not inside the sensor of 20x16"),
        (["--crop", "all"], "'all' is no rectangle"),
        (["--denoise", "0"], "'0' is no time in ms"),
        (["--polarity", "both"], "on"),
    ],
)
def test_convert_refuses_a_part_that_cannot_be(option, said, tmp_path, capsys):
    with open_writer(tmp_path / "a.npz", 20, 16) as out:
        out.write(Events.of([0], [0], [0], [1]))
    with pytest.raises((UsageError, SystemExit)) as error:
        command.run(parse("convert", tmp_path / "a.npz", tmp_path / "b.npz", *option))
    assert said in str(error.value) + capsys.readouterr().err
    assert not (tmp_path / "b.npz").exists()


def test_convert_into_dsec(capsys, tmp_path):
    """Columns and index by DSEC's own definition, t[ms_to_idx[ms] - 1] < ms <= t[ms_to_idx[ms]], with pauses; the size
    of a sensor that is higher than wide comes back."""
    rng = np.random.default_rng(4)
    t = np.sort(rng.integers(0, 60_000_000, 3000)) + 1_403_636_579_763_555_584
    t[2000:] += 25_000_000
    events = Events.of(t, rng.integers(0, 30, 3000), rng.integers(0, 40, 3000), rng.integers(0, 2, 3000))
    with open_writer(tmp_path / "a.npz", 30, 40) as out:
        out.write(events)
    assert call(capsys, "convert", tmp_path / "a.npz", tmp_path / "a.h5", "--encoding", "dsec")["events"] == 3000
    with h5py.File(tmp_path / "a.h5") as file:
        us, index, offset = file["events/t"][:].astype(np.int64), file["ms_to_idx"][:], int(file["t_offset"][()])
        assert (us + offset == t // 1000).all() and us[0] == 0 and file["events/t"].dtype == np.uint32
        for name in "xyp":
            assert (file[f"events/{name}"][:] == getattr(events, name)).all()
    assert index.tolist() == [int((us < 1000 * ms).sum()) for ms in range(len(index))] and 1000 * len(index) > us[-1]
    with open_recording(tmp_path / "a.h5") as recording:
        assert (recording.info.width, recording.info.height) == (30, 40)
        same(recording.read(), Events.of(t // 1000 * 1000, events.x, events.y, events.p))


@pytest.mark.parametrize(
    ("times", "said"),
    [([5, 4], "cannot hold times that step back"), ([0, 72 * 60 * 10**9], "after 71 minutes; take a part")],
)
def test_what_dsec_cannot_hold(times, said, tmp_path):
    with open_writer(tmp_path / "a.npz", 3, 2) as out:
        out.write(Events.of(times, [0, 1], [0, 1], [0, 1]))
    with pytest.raises(ValueError, match=said):
        command.run(parse("convert", tmp_path / "a.npz", tmp_path / "a.h5", "--encoding", "dsec"))
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


@pytest.mark.parametrize("action", ["convert", "simulate"])
def test_who_wants_a_bag_is_told_what_makes_one(action, tmp_path):
    with pytest.raises(UsageError, match=r"evis launch camera file:=RECORDING pace:=fast --record .*out\.mcap"):
        command.run(parse(action, tmp_path / "a.npz", tmp_path / "out.mcap"))
