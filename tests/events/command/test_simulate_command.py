"""`evis events simulate`: options, events against the closed form, and what stays when it ends early."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from simulate_calls import call, parse, read

from evis.cli import events as command
from nodes.event_sensor.parameters import SENSOR

MS = 1_000_000
C = 0.2


def ramp(n=101, shape=(3, 4), rate=5.0):
    """L = rate * t, one frame each ms."""
    t = np.arange(n) * MS
    return np.broadcast_to(np.exp(rate * t / 1e9)[:, None, None], (n, *shape)).astype(np.float32), t


def sinusoid_events(amplitude, frequency, phase, end, threshold):
    """(t [s], polarity) of L = A sin(2 pi f t + phase), 0 <= t <= end, reference L(0): arcsin on each monotone part."""
    turns = (np.pi / 2 - phase) / (2 * np.pi * frequency) + np.arange(-2, 2 * frequency * end + 4) / (2 * frequency)
    turns = turns[(turns > 0) & (turns < end)]
    value = lambda t: amplitude * np.sin(2 * np.pi * frequency * t + phase)
    reference, t0, events = value(0), 0.0, []
    for t1 in (*turns, end):
        sign = 1 if value(t1) > value(t0) else -1
        n = int(np.floor(sign * (value(t1) - reference) / threshold + 1e-9))
        for k in range(1, n + 1):
            base = np.arcsin(np.clip((reference + sign * k * threshold) / amplitude, -1, 1))
            # both branches of the sine; the one inside this monotone part
            angles = np.add.outer([base, np.pi - base], 2 * np.pi * np.arange(-2, frequency * end + 3)).ravel()
            times = (angles - phase) / (2 * np.pi * frequency)
            inside = times[(times >= t0 - 1e-9) & (times <= t1 + 1e-9)]
            events.append((inside[0], sign > 0))
        reference, t0 = reference + sign * max(n, 0) * threshold, t1
    return events


@pytest.mark.parametrize(("rate", "median", "missed"), [(250, 40e3, 0.02), (1000, 2.5e3, 0.005)])
def test_sinusoids_against_the_closed_form(rate, median, missed, capsys, tmp_path):
    """Linear crossings: the error falls with the square of the step, events are lost at extrema only."""
    shape, end = (6, 8), 0.4
    rng = np.random.default_rng(9)
    amplitude, frequency = rng.uniform(0.4, 1.25, shape), rng.uniform(1, 15, shape)
    phase = rng.uniform(0, 2 * np.pi, shape)
    t = np.arange(int(end * rate) + 1) * (1_000_000_000 // rate)
    level = amplitude * np.sin(2 * np.pi * frequency * t[:, None, None] / 1e9 + phase)
    np.savez(tmp_path / "f.npz", luminance=np.exp(level).astype(np.float32), t=t)
    call(capsys, tmp_path / "f.npz", tmp_path / "e.npz", "--threshold", C)
    events = read(tmp_path / "e.npz")
    errors, expected_count = [], 0
    for y, x in np.ndindex(shape):
        expected = sinusoid_events(amplitude[y, x], frequency[y, x], phase[y, x], end, C)
        expected_count += len(expected)
        here = (events.x == x) & (events.y == y)
        for on in (True, False):
            times = np.array([s * 1e9 for s, p in expected if p == on])
            got = events.t[here & (events.p == on)]
            errors += [np.abs(times - g).min() for g in got]
    assert 0 <= expected_count - len(events) <= missed * expected_count
    assert np.median(errors) < median


def test_every_parameter_is_an_option(capsys):
    """By the names of the table, with unit and default in the help."""
    with pytest.raises(SystemExit):
        parse("simulate", "--help")
    text = " ".join(capsys.readouterr().out.split())
    for name, param in SENSOR.items():
        assert f"--{name.replace('_', '-')} " in text, name
        assert param.help in text and param.unit in text
        if param.default is not None and not param.choices:
            assert f"default {param.default:g})" in text
    args = parse("simulate", "f", "o", "--threshold-mismatch", "0.03", "--defocus", "0.5", "--model", "esim")
    assert (args.threshold_mismatch, args.defocus_px, args.model) == ("0.03", "0.5", "esim")


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--threshold", "-0.2"], "threshold is -0.2 ln I, the least is 0.001 ln I"),
        (["--threshold", "much"], "threshold is 'much', must be a number"),
        (["--threshold-on", "nan"], "threshold_on is nan; it must be finite"),
        (["--crossing", "liner"], "did you mean 'linear'"),
        (["--model", "v2"], "did you mean 'v2e'"),
        (["--preset", "idael"], "preset is 'idael'"),
        (["--device", "gpu"], "no device 'gpu'"),
        (["--tone", "linear"], "is linear; a tone curve"),
        (["--colour"], "no array rgb"),
        (["--crossing", "hermite"], "no dlog_dt, which --crossing hermite needs"),
        (["--model", "esim", "--leak-rate", "3"], "--leak-rate 3 has no effect: event model esim has none"),
    ],
)
def test_bad_values_leave_no_file(options, text, tmp_path):
    """One error from the table of parameters or from the frames."""
    luminance, t = ramp()
    np.savez(tmp_path / "f.npz", luminance=luminance, t=t)
    with pytest.raises(ValueError, match=text):
        command.run(parse("simulate", tmp_path / "f.npz", tmp_path / "e.npz", *options))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["f.npz"]


def test_unknown_options_name_the_nearest(capsys):
    """Before anything is read."""
    with pytest.raises(SystemExit) as end:
        parse("simulate", "f.npz", "e.npz", "--treshold-mismatch", "0.1")
    assert end.value.code == 2
    assert "no option '--treshold-mismatch'; did you mean '--threshold-mismatch'?" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["e.npz", "e.raw", "e.csv", "e.txt"])
def test_the_same_seed_gives_the_same_file(name, capsys, tmp_path):
    """Byte for byte, in each format."""
    luminance, t = ramp()
    np.savez_compressed(tmp_path / "f.npz", luminance=luminance, t=t)
    files = []
    for _ in range(2):
        call(capsys, tmp_path / "f.npz", tmp_path / name, "--seed", 1, "--threshold", C)
        files.append((tmp_path / name).read_bytes())
    assert files[0] == files[1]
    if name.endswith((".npz", ".raw")):
        # 0.5 ln I at 0.2: two events in each of 12 pixels, at 40 and 80 ms
        events = read(tmp_path / name)
        assert len(events) == 24 and set(events.p) == {1}
        np.testing.assert_allclose(np.unique(events.t), [40 * MS, 80 * MS], atol=1000)


def test_colour_and_counts(capsys, tmp_path):
    """Each channel is a sensor of its own; NaN is counted; what a format cannot keep is said."""
    luminance, t = ramp()
    rgb = np.stack([luminance, np.ones_like(luminance), 1 / luminance], axis=-1)
    rgb[50, 1, 1, 0] = np.nan
    np.savez(tmp_path / "f.npz", rgb=rgb, t=t)
    result = call(capsys, tmp_path / "f.npz", tmp_path / "e.npz", "--colour", "--threshold", C)
    assert (result["events"], result["nonfinite"]) == (48, 1)
    events = read(tmp_path / "e.npz")
    assert np.bincount(events.c).tolist() == [24, 0, 24]
    assert (events.p == (events.c == 0)).all()
    assert call(capsys, tmp_path / "f.npz", tmp_path / "e.csv", "--colour", "--threshold", C)["colour_left_out"] == 48
    with pytest.raises(ValueError, match="evt3 has no colour channel"):
        command.run(parse("simulate", tmp_path / "f.npz", tmp_path / "e.raw", "--colour"))


def test_one_frame_makes_no_events_and_it_is_said(capsys, tmp_path):
    """The first frame is the reference."""
    luminance, t = ramp()
    np.savez(tmp_path / "f.npz", luminance=luminance[:1], t=t[:1])
    result = call(capsys, tmp_path / "f.npz", tmp_path / "e.npz")
    assert result["events"] == 0 and "events need two or more" in " ".join(result["warnings"])
    np.savez(tmp_path / "f.npz", luminance=luminance[:2], t=t[:2])
    assert "warnings" not in call(capsys, tmp_path / "f.npz", tmp_path / "e.npz")


@pytest.mark.parametrize(
    ("step", "options", "told"), [(33_333, (), True), (100_000, (), False), (33_333, ("--slow-motion", 1), True),
    (33_333, ("--fps", 30_000), False), (33_333_000, ("--slow-motion", 1000), False)],
)  # fmt: skip
def test_times_that_may_be_in_us_are_told_of(step, options, told, capsys, tmp_path):
    """30 Hz in us, and 10 kHz in ns; who gives a rate means it."""
    np.savez(tmp_path / "f.npz", luminance=np.ones((3, 4, 5), np.float32), t=np.arange(3) * step)
    made = call(capsys, tmp_path / "f.npz", tmp_path / "e.npz", *options)
    text = " ".join(made.get("warnings", []))
    assert ("frames are 33.3 us apart, 30,000 a second; times must be in ns" in text) == told


def test_rebase_for_times_that_count_from_1970(capsys, tmp_path):
    """RAW counts from 0: refused with the remedy, then done."""
    luminance, t = ramp()
    np.savez(tmp_path / "f.npz", luminance=luminance, t=t + 1_700_000_000_000_000_000)
    with pytest.raises(ValueError, match="--rebase"):
        command.run(parse("simulate", tmp_path / "f.npz", tmp_path / "e.raw"))
    assert not (tmp_path / "e.raw").exists()
    call(capsys, tmp_path / "f.npz", tmp_path / "e.raw", "--rebase", "--threshold", C)
    np.testing.assert_allclose(np.unique(read(tmp_path / "e.raw").t), [40 * MS, 80 * MS], atol=1000)


@pytest.mark.parametrize("name", ["e.npz", "e.raw"])
def test_a_bad_frame_leaves_a_valid_file(name, capsys, tmp_path):
    """A frame of another size at 61 ms: the events before it are in the file, and the error says up to where."""
    from PIL import Image

    (tmp_path / "f").mkdir()
    for i in range(100):
        size = (4, 3) if i != 61 else (4, 4)
        Image.new("L", size, round(100 * np.exp(0.005 * i))).save(tmp_path / "f" / f"{i}.png")
    options = ["--fps", 1000, "--tone", "linear", "--threshold", C]
    text = r"61\.png: 4x4, the frames before are 4x3; .* holds the events of 61 of 100 frames, up to t = 60000000 ns"
    with pytest.raises(ValueError, match=text):
        command.run(parse("simulate", tmp_path / "f", tmp_path / name, *options))
    assert sorted(p.name for p in tmp_path.iterdir()) == [name, "f"]
    got = read(tmp_path / name)
    Image.new("L", (4, 3), round(100 * np.exp(0.305))).save(tmp_path / "f" / "61.png")
    assert call(capsys, tmp_path / "f", tmp_path / name, *options)["tone"] == "linear"
    whole = read(tmp_path / name)
    assert len(got) == 12 < len(whole)
    np.testing.assert_array_equal(got.t, whole.t[:12])


def test_ctrl_c_leaves_a_valid_file(tmp_path):
    """Interrupted between two frames that a slow source gives: status 1, one line, and the events so far."""
    script = f"""
import sys, time
import numpy as np
from evis.media.frames import open as opened
from evis.media.frames import source as frames
from evis.cli import main

class Slow(frames.ImageSource):
    kind, width, height, channels, count, about = "slow", 4, 3, 1, None, {{}}
    def block_frames(self):
        return 1
    def _images(self):
        for i in range(10_000):
            if i == 120:
                print("far enough", flush=True)
            time.sleep(0.01 if i >= 120 else 0)
            yield frames.NamedImage(str(i), i * 1_000_000, np.full((3, 4), np.exp(0.005 * i), np.float32))

opened.open_frames = lambda path, options: Slow()
sys.exit(main(["events", "simulate", "slow", {str(tmp_path / "e.npz")!r}, "--threshold", "0.2"]))
"""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    pipe = subprocess.PIPE
    process = subprocess.Popen([sys.executable, "-c", script], stdout=pipe, stderr=pipe, text=True, env=environment)
    assert process.stdout is not None and process.stdout.readline() == "far enough\n"
    time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=600)
    assert process.returncode == 1
    assert errors.count("\n") == 1 and "stopped; " in errors and "holds the events of" in errors
    frames = int(errors.partition("holds the events of ")[2].split()[0])
    events = read(tmp_path / "e.npz")
    assert 120 <= frames < 10_000
    assert len(events) == 12 * int((frames - 1) * 0.005 / C + 1e-6)
    assert [p.name for p in tmp_path.iterdir()] == ["e.npz"]


def test_exported_keyframes_are_frames(capsys, tmp_path):
    """What `evis bag export` writes as EXR gives the events of the same frames as an array, at the same times."""
    from evis.bag.export import exr, keyframes
    from msgs.camera import Keyframe
    from msgs.header import Header

    rng = np.random.default_rng(11)
    stamps = [0, 33_333_333, 66_666_667]
    radiance = rng.uniform(0.1, 5, (3, 10, 12, 3)).astype(np.float32)
    (tmp_path / "exr").mkdir()
    for i, stamp in enumerate(stamps):
        keyframe = Keyframe(Header(stamp), np.zeros(1, np.int32), radiance[i : i + 1])
        arrays, _ = keyframes.channels({Keyframe: keyframe}, 0, half=False)
        exr.write(tmp_path / "exr" / f"{i}.exr", arrays, stamp)
    np.savez(tmp_path / "f.npz", rgb=radiance, t=np.array(stamps))
    for options in ([], ["--colour"]):
        call(capsys, tmp_path / "exr", tmp_path / "a.npz", *options)
        call(capsys, tmp_path / "f.npz", tmp_path / "b.npz", *options)
        assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
        assert len(read(tmp_path / "a.npz"))
