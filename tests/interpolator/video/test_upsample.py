"""Frames upsampled along optical flow, against scenes whose frames at 1 kHz are known in closed form."""

from __future__ import annotations

import sys
import weakref

import numpy as np
import pytest

from evis.events.measure.distance import EventStream, victor_purpura
from evis.media.frames.source import FrameBlock
from nodes.event_sensor.simulate import simulate_frames
from nodes.interpolator.video.between import load_interpolator
from nodes.interpolator.video.flow import DenseFlow
from nodes.interpolator.video.upsample import Upsampler

W, H = 120, 90
MS = 1_000_000
C = 0.2
NEARER = 2.5
"""How many times nearer to the dense frames' events those of upsampled frames are, at least."""
Q = 0.1
"""Cost of a shift of Victor and Purpura [1/ms]: events more than 20 ms apart are not the same."""

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed (pip install 'evis[video]')")


def texture(x, y):
    """Sinusoids of 10 px and more in all directions; ln of it has a standard deviation of 0.6."""
    rng = np.random.default_rng(1)
    waves, phases = rng.normal(size=(24, 2)) * 0.3, rng.uniform(0, 2 * np.pi, 24)
    return np.exp(0.2 * sum(np.sin(k * x + m * y + p) for (k, m), p in zip(waves, phases)))


def slide(t, x, y):
    return texture(x - 120 * t, y + 60 * t)


def turn(t, x, y):
    c, s = np.cos(3 * t), np.sin(3 * t)
    x, y = x - W / 2, y - H / 2
    return texture(c * x + s * y, c * y - s * x)


def ball(t, x, y):
    """A textured ball before a texture that stands still, with a soft edge of a pixel."""
    inside = 1 / (1 + np.exp(np.hypot(x - 40 - 150 * t, y - 45 - 10 * np.sin(20 * t)) - 20))
    return texture(x, y) * (1 - inside) + inside * texture(x - 150 * t + 300, y - 10 * np.sin(20 * t) + 70)


def rendered(scene, stamps):
    y, x = np.mgrid[:H, :W].astype(float)
    return np.stack([scene(t / 1e9, x, y) for t in stamps]).astype(np.float32)


def upsampled(upsampler, stamps, images):
    blocks = list(upsampler.blocks(iter([FrameBlock(stamps, images)])))
    return np.concatenate([b.t for b in blocks]), np.concatenate([b.image for b in blocks])


def stream(images, stamps):
    e = simulate_frames(images, stamps, threshold=C)
    return EventStream(e["t"], e["x"], e["y"], e["p"], W, H)


@pytest.mark.parametrize(("scene", "rate"), [(slide, 30), (turn, 30), (ball, 60)])
def test_events_are_nearer_to_those_of_dense_frames(scene, rate):
    """Frames at 30 or 60 Hz, upsampled, against the scene at 1 kHz; without upsampling beside it."""
    dense, sparse = np.arange(301) * MS, np.array([round(i * 1e9 / rate) for i in range(int(0.3 * rate) + 1)])
    truth, images = stream(rendered(scene, dense), dense), rendered(scene, sparse)
    upsampler = Upsampler()
    stamps, frames = upsampled(upsampler, sparse, images)
    without, with_it = (victor_purpura(stream(f, t), truth, Q) for f, t in ((images, sparse), (frames, stamps)))
    assert without > 0.15 and with_it * NEARER < without
    report = upsampler.report()
    assert report["gaps"] == len(sparse) - 1 and report["sub_frames"] == len(stamps) - len(sparse)
    assert report["flow_agrees"] > 0.8 and report["motion_per_frame_px"] <= 1
    assert f"agrees for {100 * upsampler.agreement:.1f} % of the moving pixels" in upsampler.warnings()[0]


def test_frames_of_the_source_stay_as_they_are():
    """At their own times, to the bit; sub-frames stand at equal steps between them."""
    stamps = np.array([0, 10 * MS, 37 * MS])
    images = rendered(slide, stamps)
    t, frames = upsampled(Upsampler(5), stamps, images)
    assert t.tolist() == [0, *range(2 * MS, 11 * MS, 2 * MS), *(10 * MS + 27 * MS * np.arange(1, 6) // 5)]
    np.testing.assert_array_equal(frames[[0, 5, 10]], images)


def test_a_picture_that_stands_still_is_left_alone():
    """No sub-frames, and nothing to warn of."""
    images = np.repeat(rendered(slide, [0]), 5, axis=0)
    upsampler = Upsampler()
    t, frames = upsampled(upsampler, np.arange(5) * MS, images)
    np.testing.assert_array_equal(frames, images)
    assert t.tolist() == [i * MS for i in range(5)]
    assert upsampler.report() == {
        "gaps": 4, "sub_frames": 0, "largest_motion_px": 0, "motion_per_frame_px": 0, "flow_agrees": None,
        "gaps_left": 0,
    }  # fmt: skip
    assert upsampler.warnings() == []


def test_light_that_changes_fades():
    """A still picture that gets 2 % brighter: the straight line between both, not a step."""
    first = rendered(slide, [0])[0]
    _, frames = upsampled(Upsampler(4), np.array([0, 4 * MS]), np.stack([first, np.float32(1.02) * first]))
    # what moves by less than 0.1 px is still; flow is looked for in 8 bits, so that some pixels do move
    for i, frame in enumerate(frames):
        assert np.median(frame / first) == pytest.approx(1 + 0.005 * i, abs=2e-4)


def test_a_cut_is_not_interpolated():
    """Two pictures that have nothing to do with each other."""
    rng = np.random.default_rng(5)
    images = rng.random((3, H, W), np.float32)
    images[2] = images[1]
    upsampler = Upsampler()
    t, frames = upsampled(upsampler, np.arange(3) * 40 * MS, images)
    np.testing.assert_array_equal(frames, images)
    assert upsampler.report()["gaps_left"] == 1 and len(t) == 3
    assert "1 of 2 gaps have no sub-frames" in upsampler.warnings()[0]


@pytest.mark.parametrize("shift", [(1.5, 0.25), (-6.0, 9.0)])
def test_flow_of_a_known_shift(shift):
    """Where the picture stays in sight: to 0.1 px on average, and both ways agree."""
    y, x = np.mgrid[:H, :W].astype(float)
    a, b = (texture(x - s * shift[0], y - s * shift[1]).astype(np.float32) for s in (0, 1))
    flow = DenseFlow().between(a, b)
    inner = slice(15, -15), slice(15, -15)
    assert np.abs(flow.forward[inner] - shift).mean() < 0.1 and np.abs(flow.backward[inner] + shift).mean() < 0.1
    assert flow.agrees_a[inner].mean() > 0.99
    # what leaves the picture cannot agree
    gone = np.zeros((H, W), bool)
    gone[(y + shift[1] < -1) | (y + shift[1] > H) | (x + shift[0] < -1) | (x + shift[0] > W)] = True
    assert flow.agrees_a[gone].mean() < 0.2


def test_the_number_of_threads_does_not_matter():
    """Neither the program's own nor OpenCV's, whose setting is left as it was."""
    stamps = np.array([0, 33 * MS])
    images, made = rendered(turn, stamps), []
    before = cv2.getNumThreads()
    try:
        for threads in (1, 2):
            cv2.setNumThreads(threads)
            made.append(upsampled(Upsampler(), stamps, images)[1])
            assert cv2.getNumThreads() == threads
    finally:
        cv2.setNumThreads(before)
    np.testing.assert_array_equal(*made)


@pytest.mark.parametrize("shape", [(3, 4), (1, 1), (40, 9, 3), (90, 120, 3)])
def test_any_size_and_colour(shape):
    """Pictures too small for flow, narrow ones, and RGB, of which each channel moves alike."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    images = np.stack([texture(x - s, y) for s in (0, 3)]).astype(np.float32)
    if len(shape) == 3:
        images = images[..., None] * np.array([1, 0.5, 0.25], np.float32)
    _, frames = upsampled(Upsampler(4), np.array([0, MS]), images)
    assert frames.shape[1:] == shape and np.isfinite(frames).all() and frames.dtype == np.float32
    if len(shape) == 3:
        np.testing.assert_allclose(frames[..., 0], 4 * frames[..., 2], rtol=1e-5)


def test_few_frames_are_in_memory():
    """Of a source of 300 frames: two, those of a gap, and what is being made."""
    alive, most = set(), 0

    def blocks():
        nonlocal most
        y, x = np.mgrid[:40, :50].astype(float)
        for i in range(300):
            image = texture(x - i, y).astype(np.float32)[None]
            alive.add(i)
            weakref.finalize(image, alive.discard, i)
            most = max(most, len(alive))
            yield FrameBlock(np.array([i * MS]), image)

    for _ in Upsampler(2).blocks(blocks()):
        pass
    assert most <= 5


OWN = """
import numpy as np

class Fade:
    def between(self, a, b, at):
        return np.stack([a * np.float32(1 - s) + b * np.float32(s) for s in at])

class Few(Fade):
    def between(self, a, b, at):
        return super().between(a, b, at)[1:]

class Broken(Fade):
    def __init__(self):
        raise RuntimeError("no\\nweights")

class Other:
    pass
"""


@pytest.fixture
def own(tmp_path, monkeypatch):
    """A module of the user's in the current folder."""
    (tmp_path / "my_video_module.py").write_text(OWN)
    (tmp_path / "my_bad_module.py").write_text("import nothing_of_the_kind")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield "my_video_module"
    sys.modules.pop("my_video_module", None)


def test_an_interpolator_of_the_user(own, monkeypatch):
    """It gets both frames and the times between, and needs no optical flow for a given number."""
    monkeypatch.setitem(sys.modules, "cv2", None)
    stamps = np.array([0, 8 * MS])
    images = rendered(slide, stamps)
    upsampler = Upsampler(4, load_interpolator(f"{own}:Fade"))
    t, frames = upsampled(upsampler, stamps, images)
    assert t.tolist() == [0, 2 * MS, 4 * MS, 6 * MS, 8 * MS]
    np.testing.assert_allclose(frames[1], 0.75 * images[0] + 0.25 * images[1], rtol=1e-6)
    assert upsampler.report() == {"gaps": 1, "sub_frames": 3} and "your interpolator" in upsampler.warnings()[0]
    with pytest.raises(
        ValueError, match=r"Few\.between gave float32 \[2, 90, 120\]; it must be float32 \[3, 90, 120\]"
    ):
        upsampled(Upsampler(4, load_interpolator(f"{own}:Few")), stamps, images)


def test_an_interpolator_of_the_user_with_as_many_frames_as_the_motion_asks_for(own):
    """The number is found from flow, the frames are the user's."""
    images = rendered(slide, np.array([0, 33 * MS]))
    upsampler = Upsampler(None, load_interpolator(f"{own}:Fade"))
    _, frames = upsampled(upsampler, np.array([0, 33 * MS]), images)
    assert len(frames) - 1 >= 33 * MS / 1e9 * np.hypot(120, 60)
    np.testing.assert_allclose(frames[1], images[0] + (images[1] - images[0]) / (len(frames) - 1), rtol=1e-5)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("Fade", "write it as my_module:MyInterpolator"),
        ("no_module_of_this_name:Fade", "cannot be imported: ModuleNotFoundError"),
        ("my_bad_module:Fade", "nothing_of_the_kind"),
        ("my_video_module:Fad", "no class Fad with a method `between`; did you mean 'Fade'"),
        ("my_video_module:Other", "no class Other with a method"),
        ("my_video_module:Broken", "cannot be made: RuntimeError: no weights"),
    ],
)
def test_bad_interpolators(name, text, own):
    with pytest.raises(ValueError, match=text) as raised:
        load_interpolator(name)
    assert "\n" not in str(raised.value)


def test_without_opencv_the_remedy_is_told(monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(ValueError, match=r"pip install 'evis\[video\]', or give --upsample N with an --interpolator"):
        Upsampler()
    with pytest.raises(ValueError, match="upsample is 1000; it must be 1 to 256"):
        Upsampler(1000)
