"""`evis events simulate` on videos and images: parts, sizes, sub-frames, and what such frames cannot tell."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from fractions import Fraction

import numpy as np
import pytest
from PIL import Image
from simulate_calls import call, parse, read

from evis.cli import events as command
from evis.cli.parser import UsageError

N, W, H = 24, 64, 48
MS = 1_000_000


def film():
    """Codes uint8 [N, H, W, 3] of a pattern that slides by 2 px per frame; none at an end of the code."""
    y, x = np.mgrid[:H, :W]
    frames = [120 + 60 * np.sin((x - 2 * i) / 4) + 40 * np.cos(y / 5) for i in range(N)]
    return np.repeat(np.stack(frames)[..., None], 3, axis=3).astype(np.uint8) - np.array([0, 5, 9], np.uint8)


@pytest.fixture
def folder(tmp_path):
    """The film as PNG."""
    (tmp_path / "f").mkdir()
    for i, image in enumerate(film()):
        Image.fromarray(image).save(tmp_path / "f" / f"{i}.png")
    return tmp_path / "f"


@pytest.mark.parametrize("options", [[], ["--colour", "--white", 30], ["--upsample", 4, "--slow-motion", 10]])
def test_frames_that_are_saved_give_the_same_events_again(options, capsys, tmp_path, folder):
    """Byte for byte, from the light and the times of all frames that the sensor had."""
    if "--upsample" in options:
        pytest.importorskip("cv2", reason="OpenCV is not installed (pip install 'evis[video]')")
    kept = tmp_path / "kept"
    made = call(capsys, folder, tmp_path / "a.npz", "--fps", 25, "--save-frames", kept, *options)
    assert made["saved_frames"] == made["frames"] == len(list(kept.iterdir())) >= N and made["events"] > 1000
    again = call(capsys, kept, tmp_path / "b.npz", *options[:1] * ("--colour" in options))
    assert again["frames"] == made["frames"]
    a, b = (dict(np.load(tmp_path / name)) for name in ("a.npz", "b.npz"))
    assert a.keys() == b.keys() and all(np.array_equal(a[name], b[name]) for name in a)


@pytest.mark.parametrize(
    "options",
    [
        [],
        ["--crop", "8,4,40,30", "--size", "20x15", "--from", 0.2, "--to", 0.6, "--slow-motion", 10],
        ["--upsample", "auto", "--width", 32, "--colour"],
    ],
)
def test_a_folder_is_the_same_as_its_lossless_video(options, capsys, tmp_path, folder):
    """Byte for byte, with every option for frames."""
    av = pytest.importorskip("av", reason="PyAV is not installed (pip install 'evis[video]')")
    if "--upsample" in options:
        pytest.importorskip("cv2", reason="OpenCV is not installed (pip install 'evis[video]')")
    with av.open(str(tmp_path / "v.mkv"), "w") as file:
        track = file.add_stream("ffv1", rate=25)
        track.width, track.height, track.pix_fmt = W, H, "bgr0"
        for i, image in enumerate(film()):
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts, frame.time_base = i, Fraction(1, 25)
            file.mux(track.encode(frame))
        file.mux(track.encode())
    made = call(capsys, folder, tmp_path / "a.npz", "--fps", 25, *options)
    video = call(capsys, tmp_path / "v.mkv", tmp_path / "b.npz", *options)
    pattern = call(capsys, tmp_path / "f" / "*.png", tmp_path / "c.npz", "--fps", 25, *options)
    same = {"out", "source"}
    assert {k: v for k, v in made.items() if k not in same} == {k: v for k, v in video.items() if k not in same}
    assert made["events"] == pattern["events"] > 100
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes() == (tmp_path / "c.npz").read_bytes()


def test_parts_are_those_of_an_array_cut_by_hand(capsys, tmp_path, folder):
    """Crop, time, slow motion: the same events as of the linear frames, cut and slowed in NumPy."""
    code = film() / 255
    light = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722]
    # frames are 40 ms apart; 0.2 s is frame 5, 0.64 s is frame 16, not included
    t = np.arange(5, 16) * 40 * MS // 8
    np.savez(tmp_path / "f.npz", luminance=light[5:16, 4:34, 8:48].astype(np.float32), t=t)
    options = ["--fps", 25, "--crop", "8,4,40,30", "--from", 0.2, "--to", 0.64, "--slow-motion", 8]
    made = call(capsys, folder, tmp_path / "a.npz", *options)
    assert (made["frames"], made["width"], made["height"]) == (11, 40, 30)
    expected = call(capsys, tmp_path / "f.npz", tmp_path / "b.npz")
    got, wanted = read(tmp_path / "a.npz"), read(tmp_path / "b.npz")
    assert made["events"] == expected["events"] > 500
    # pixel by pixel: float32 of two ways to the same number may change the order of two pixels
    orders = [np.lexsort((e.t, e.x, e.y)) for e in (got, wanted)]
    for name in ("x", "y", "p"):
        np.testing.assert_array_equal(*(getattr(e, name)[order] for e, order in zip((got, wanted), orders)))
    np.testing.assert_allclose(got.t[orders[0]], wanted.t[orders[1]], atol=200)


@pytest.mark.parametrize(
    ("options", "size"),
    [
        (["--size", "davis346"], (346, 260)),
        (["--size", "preset", "--preset", "dvs128"], (128, 128)),
        (["--size", "30x20"], (30, 20)),
        (["--width", 32], (32, 24)),
        (["--height", 12], (16, 12)),
        (["--width", 10, "--height", 40], (10, 40)),
    ],
)
def test_sizes(options, size, capsys, tmp_path, folder):
    made = call(capsys, folder, tmp_path / "e.npz", "--fps", 500, *options)
    assert (made["width"], made["height"]) == size
    wider = size[0] * H / (size[1] * W)
    said = [w for w in made.get("warnings", []) if "times as wide" in w]
    assert said == ([] if abs(wider - 1) < 0.02 else [f"the picture is {wider:.2f} times as wide as it was; --crop a "
                                                      "part of OUT's proportions"])  # fmt: skip


def test_sub_frames_are_told_of(capsys, tmp_path, folder):
    """How many, along which motion, and how far they can be trusted; without them, that frames are far apart."""
    pytest.importorskip("cv2", reason="OpenCV is not installed (pip install 'evis[video]')")
    plain = call(capsys, folder, tmp_path / "a.npz", "--fps", 25)
    assert any("frames are 40 ms apart" in w and "--upsample auto" in w for w in plain["warnings"])
    made = call(capsys, folder, tmp_path / "b.npz", "--fps", 25, "--upsample", "auto")
    told = made["upsampling"]
    assert made["source_frames"] == N and told["gaps"] == N - 1 and made["frames"] == N + told["sub_frames"]
    # 2 px per frame
    assert told["largest_motion_px"] == pytest.approx(2, abs=0.6) and told["motion_per_frame_px"] <= 1
    assert any("made from optical flow, not seen" in w for w in made["warnings"])
    fixed = call(capsys, folder, tmp_path / "c.raw", "--fps", 25, "--upsample", 4)
    assert fixed["frames"] == 4 * (N - 1) + 1 and read(tmp_path / "c.raw").t.max() <= (N - 1) * 40 * MS


def test_the_ends_of_the_code_are_counted(capsys, tmp_path):
    """Full scale in any channel, black in all, and the part of the code that is coarser than a threshold."""
    (tmp_path / "f").mkdir()
    image = np.full((10, 20, 3), 128, np.uint8)
    image[:2, :, 0] = 255
    image[2:3] = 0
    image[3:7] = 3
    for i in range(2):
        Image.fromarray(image).save(tmp_path / "f" / f"{i}.png")
    made = call(capsys, tmp_path / "f", tmp_path / "e.npz", "--fps", 1000)
    assert (made["full_scale_share"], made["black_share"], made["coarse_share"]) == (0.2, 0.1, 0.5)
    text = " ".join(made["warnings"])
    # sRGB is linear there: ln(5/4) > 0.2 > ln(6/5)
    assert "20.0 % of the pixels are at full scale" in text and "10.0 % of the pixels are code 0" in text
    assert "50.0 % of the pixels are below code 5" in text
    cropped = call(capsys, tmp_path / "f", tmp_path / "e.npz", "--fps", 1000, "--crop", "0,7,20,3")
    assert (cropped["full_scale_share"], cropped["black_share"]) == (0, 0) and "warnings" not in cropped
    dark = call(capsys, tmp_path / "f", tmp_path / "e.npz", "--fps", 1000, "--dark-level", 0.01)
    assert dark["coarse_share"] == 0


@pytest.mark.parametrize(
    ("shown", "repeated"),
    [
        (range(40), 0),
        ([i // 2 for i in range(40)], 18),  # of 30 Hz at 60; the first and the last pair have no change before, after
        ([i * 2 // 5 for i in range(40)], 21),  # of 24 Hz at 60: rows of 3 and 2, the first and the last left out
        ([*range(12), *[12] * 20, *range(12, 20)], 0),  # at rest for a while
    ],
)
def test_repeated_frames_are_counted(shown, repeated, capsys, tmp_path):
    """Across blocks of 32 frames, too."""
    (tmp_path / "f").mkdir()
    for i, place in enumerate(shown):
        Image.fromarray(np.roll(film()[0], 3 * place, 1)).save(tmp_path / "f" / f"{i}.png")
    made = call(capsys, tmp_path / "f", tmp_path / "e.npz", "--fps", 1000)
    assert made.get("repeated_frames", 0) == repeated
    text = " ".join(made.get("warnings", []))
    assert (f"{repeated} of 40 frames repeat the one before" in text) == bool(repeated)


def test_interlaced_frames_are_told_of(capsys, tmp_path):
    """Of MPEG-4, whose frames say whether they are two fields."""
    av = pytest.importorskip("av", reason="PyAV is not installed (pip install 'evis[video]')")
    for name, options, told in (("i.mp4", {"flags": "+ildct+ilme"}, 3), ("p.mp4", {}, 0)):
        with av.open(str(tmp_path / name), "w") as file:
            track = file.add_stream("mpeg4", rate=25, options=options)
            track.width, track.height, track.pix_fmt = W, H, "yuv420p"
            for image in film()[:3]:
                file.mux(track.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
            file.mux(track.encode())
        made = call(capsys, tmp_path / name, tmp_path / "e.npz")
        assert made.get("interlaced_frames", 0) == told
        assert ("3 frames are interlaced" in " ".join(made["warnings"])) == bool(told)


def test_codes_of_10_bits_are_coarse_where_their_own_steps_are(capsys, tmp_path):
    """A step from code 3 of 1,023 is 0.29 of ln I, far more than that of 16 bits in which a video's frames are kept."""
    av = pytest.importorskip("av", reason="PyAV is not installed (pip install 'evis[video]')")
    with av.open(str(tmp_path / "v.mkv"), "w") as file:
        track = file.add_stream("ffv1", rate=1000)
        track.width, track.height, track.pix_fmt = W, H, "gray10le"
        for i in range(2):
            codes = np.repeat([3, 500], H // 2)[:, None].repeat(W, 1).astype("<u2")
            frame = av.VideoFrame.from_ndarray(codes, "gray10le")
            frame.pts, frame.time_base = i, Fraction(1, 1000)
            file.mux(track.encode(frame))
        file.mux(track.encode())
    made = call(capsys, tmp_path / "v.mkv", tmp_path / "e.npz")
    assert (made["bits"], made["coarse_share"]) == (10, 0.5)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--from", 2, "--to", 1], "--from 2 to 1 s: the end must be later than the start"),
        (["--from", -1], "0 or more"),
        (["--from", 5], "f: from 5 s: the source has no frame then|from 5 s: the source has no frame then"),
        (["--fps", -25], "--fps is -25, must be"),
        (["--slow-motion", 0], "--slow-motion is 0, must be above 0"),
        (["--crop", "60,0,20,20"], "f: crop 60,0,20,20 is not inside the frames of 64x48"),
        (["--width", 0], "--width is 0"),
        (["--size", "10x10", "--width", 5], "--size says both sides"),
        (["--size", "preset"], "preset ideal is no sensor with a size; dvs128, davis346"),
        (["--upsample", 999], "upsample is 999; it must be 1 to 256"),
        (["--interpolator", "m:C"], "--interpolator m:C has no effect without --upsample"),
        (["--upsample", 2, "--interpolator", "m"], "write it as my_module:MyInterpolator"),
        (["--save-frames", "."], "--save-frames . is not empty; name a new folder"),
        (["--save-frames", "new", "--crossing", "hermite"], "--save-frames keeps no dlog_dt"),
        (["--upsample", 2, "--crossing", "hermite"], "--crossing hermite needs dlog_dt, which sub-frames do not have"),
    ],
)
def test_bad_values_leave_no_file(options, text, tmp_path, folder):
    """One line that names the option."""
    if options[0] == "--upsample" and "--crossing" in options:
        pytest.importorskip("cv2", reason="OpenCV is not installed (pip install 'evis[video]')")
    if "--fps" not in options:
        options = [*options, "--fps", 25]
    with pytest.raises(ValueError, match=text) as raised:
        command.run(parse("simulate", folder, tmp_path / "e.npz", *options))
    assert "\n" not in str(raised.value) and not (tmp_path / "e.npz").exists()


def test_a_folder_for_frames_is_made_for_a_frame(tmp_path, folder):
    """Nothing is left of it where there is no run, and a file in its place is told of."""
    kept = tmp_path / "kept"
    for out, text in (("no/e.npz", "the folder .*no does not exist"), ("file/e.npz", "file is a file, and no folder")):
        (tmp_path / "file").touch()
        with pytest.raises(ValueError, match=text):
            command.run(parse("simulate", folder, tmp_path / out, "--fps", 25, "--save-frames", kept))
        assert not kept.exists()
    for place in (tmp_path / "file", tmp_path / "file" / "in_it"):
        with pytest.raises(UsageError, match="Not a directory; name a new folder"):
            command.run(parse("simulate", folder, tmp_path / "e.npz", "--fps", 25, "--save-frames", place))
    assert [p.name for p in tmp_path.glob("*e.npz*")] == []


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--crop", "1,2,3"], "'1,2,3' is no rectangle; write x,y,width,height"),
        (["--size", "davis34"], "did you mean 'davis346'"),
        (["--size", "10x0"], "is no size"),
        (["--upsample", "often"], "'often' must be auto, none or a number"),
        (["--from", "soon"], "'soon' is no time in seconds"),
        (["--to", "nan"], "'nan' is no time in seconds"),
    ],
)
def test_bad_words_are_named(options, text, capsys):
    with pytest.raises(SystemExit) as end:
        parse("simulate", "f", "e.npz", *options)
    assert end.value.code == 2 and text in capsys.readouterr().err


def test_a_folder_that_is_not_there(tmp_path, folder):
    with pytest.raises(ValueError, match="no such file or folder; did you mean 'f'"):
        command.run(parse("simulate", tmp_path / "ff", tmp_path / "e.npz"))


def test_a_bad_frame_among_sub_frames_leaves_a_valid_file(tmp_path, folder, capsys):
    """The events up to the last good frame of the source are in the file."""
    pytest.importorskip("cv2", reason="OpenCV is not installed (pip install 'evis[video]')")
    options = ["--fps", 25, "--upsample", 3]
    call(capsys, folder, tmp_path / "whole.npz", *options)
    (folder / "9.png").write_bytes((folder / "9.png").read_bytes()[:60])
    text = r"9\.png: cannot be read as PNG.*; .* holds the events of 9 of 24 frames, up to t = 320000000 ns"
    with pytest.raises(ValueError, match=text):
        command.run(parse("simulate", folder, tmp_path / "e.npz", *options))
    whole, got = read(tmp_path / "whole.npz"), read(tmp_path / "e.npz")
    assert len(got) == (whole.t <= 320 * MS).sum() > 0
    np.testing.assert_array_equal(got.t, whole.t[: len(got)])


def test_ctrl_c_among_sub_frames_leaves_a_valid_file(tmp_path):
    """Between two gaps of a source that is slow: the events so far, and the frames of the source that they are of."""
    (tmp_path / "slow_video.py").write_text(
        "import time\nimport numpy as np\n\nclass Slow:\n    gaps = 0\n    def between(self, a, b, at):\n"
        "        Slow.gaps += 1\n        if Slow.gaps == 30:\n            print('far enough', flush=True)\n"
        "        time.sleep(0.02 if Slow.gaps >= 30 else 0)\n"
        "        return np.stack([a * np.float32(1 - s) + b * np.float32(s) for s in at])\n"
    )
    t = np.arange(2000) * MS
    light = np.broadcast_to(np.exp(5e-9 * t)[:, None, None], (2000, 3, 4)).astype(np.float32)
    np.savez(tmp_path / "f.npz", luminance=light, t=t)
    words = ["events", "simulate", "f.npz", "e.npz", "--upsample", "2", "--interpolator", "slow_video:Slow"]
    code = f"import sys; from evis.cli import main; sys.exit(main({words!r}))"
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    pipe = subprocess.PIPE
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=pipe, stderr=pipe, text=True, env=environment, cwd=tmp_path
    )
    assert process.stdout is not None and process.stdout.readline() == "far enough\n"
    time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=600)
    assert process.returncode == 1
    assert errors.count("\n") == 1 and "stopped; " in errors
    frames = int(errors.partition("holds the events of ")[2].split()[0])
    assert 30 <= frames < 2000
    # 12 pixels, an event each 0.2 / 5 s
    assert len(read(tmp_path / "e.npz")) == 12 * int((frames - 1) * 0.005 / 0.2 + 1e-4)
