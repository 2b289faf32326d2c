"""Frames of videos: values, times, and files that end too early."""

from __future__ import annotations

import shutil
import struct
import sys

import numpy as np
import pytest

from evis.media.frames.ends import BLACK, FULL
from evis.media.frames.open import open_frames
from evis.media.frames.source import FrameOptions, FramesError


def test_without_pyav_the_remedy_is_told(tmp_path, monkeypatch):
    """The extra to install, and the way without it."""
    (tmp_path / "v.mp4").write_bytes(b"\0\0\0\x18ftypmp42")
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(FramesError, match=r"v\.mp4: .* pip install 'evis\[video\]', or give a folder of PNG"):
        open_frames(tmp_path / "v.mp4")


@pytest.fixture
def av():
    """PyAV, the optional reader."""
    return pytest.importorskip("av", reason="PyAV is not installed (pip install 'evis[video]')")


def write(av, path, frames, *, codec="ffv1", pixels="bgr0", rate=100, times=None):
    """A video of uint8 [T, H, W, 3], times [ticks of 1/rate] given or 0, 1, 2, ..."""
    from fractions import Fraction

    options = {"movflags": "faststart"} if path.suffix == ".mp4" else {}
    with av.open(str(path), "w", options=options) as file:
        stream = file.add_stream(codec, rate=rate)
        stream.height, stream.width = frames.shape[1:3]
        stream.pix_fmt = pixels
        stream.codec_context.time_base = Fraction(1, rate)
        for i, image in enumerate(frames):
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts, frame.time_base = (i if times is None else times[i]), Fraction(1, rate)
            for packet in stream.encode(frame):
                file.mux(packet)
        for packet in stream.encode():
            file.mux(packet)


def noise(n, height=48, width=64):
    return np.random.default_rng(7).integers(0, 256, (n, height, width, 3)).astype(np.uint8)


def frames_of(path, **options):
    with open_frames(path, FrameOptions(**options)) as source:
        blocks = list(source.blocks())
    return np.concatenate([b.t for b in blocks]), np.concatenate([b.image for b in blocks])


def write_planes(av, path, pixels, values, color_range=0, **told):
    """A lossless video of frames of one colour, values uint16 [T][plane]. told: what the file says of its codes."""
    from fractions import Fraction

    with av.open(str(path), "w") as file:
        stream = file.add_stream("ffv1", rate=10)
        stream.height, stream.width, stream.pix_fmt = 32, 32, pixels
        told["color_range"] = color_range
        for name, value in told.items():
            setattr(stream.codec_context, name, value)
        for i, planes in enumerate(values):
            frame = av.VideoFrame(32, 32, pixels)
            for plane, value in zip(frame.planes, planes):
                plane.update(np.full(plane.buffer_size // 2, value, np.uint16).tobytes())
            frame.pts, frame.time_base = i, Fraction(1, 10)
            for name, value in told.items():
                setattr(frame, name, value)
            file.mux(stream.encode(frame))
        file.mux(stream.encode())


@pytest.mark.parametrize(
    "pixels, full_range, black, grey, white",
    [
        ("yuv420p10le", False, (64, 512, 512), (502, 512, 512), (940, 512, 512)),
        ("yuv444p12le", False, (256, 2048, 2048), (2008, 2048, 2048), (3760, 2048, 2048)),
        ("yuv420p10le", True, (0, 512, 512), (511, 512, 512), (1023, 512, 512)),
        ("gray10le", False, (0,), (511,), (1023,)),
        ("gbrp10le", False, (0, 0, 0), (511, 511, 511), (1023, 1023, 1023)),
    ],
)
def test_white_of_more_than_8_bits_is_full_scale(pixels, full_range, black, grey, white, av, tmp_path):
    """Rec. 601 and 709: black 64 and white 940 of 10 bits; grey and RGB, as luma of full range, go to 1023."""
    write_planes(av, tmp_path / "v.mkv", pixels, [black, grey, white], 2 if full_range else 0)
    with open_frames(tmp_path / "v.mkv", FrameOptions(tone="linear", ends=True)) as source:
        (block,) = source.blocks()
    share = (grey[0] - black[0]) / (white[0] - black[0])
    np.testing.assert_allclose(block.image[:, 9, 9], [0, share, 1], atol=4 / 65535, rtol=0)
    assert [int(ends[9, 9]) for ends in block.ends] == [BLACK, 0, FULL]


@pytest.mark.parametrize("pixels", ["yuv420p", "yuv422p", "yuv444p"])
@pytest.mark.parametrize(("full_range", "black", "white"), [(False, 16, 235), (True, 0, 255)])
def test_every_code_of_luma_has_its_light(pixels, full_range, black, white, av, tmp_path):
    """Rec. 601 and 709 have 219 steps from black to white, which are no whole codes of 255."""
    from fractions import Fraction

    luma = np.arange(black, white + 1)
    with av.open(str(tmp_path / "v.mkv"), "w") as file:
        stream = file.add_stream("ffv1", rate=10)
        stream.height, stream.width, stream.pix_fmt = 32, 256, pixels
        for i in range(2):
            frame = av.VideoFrame(256, 32, pixels)
            for plane, value in zip(frame.planes, (0, 128, 128)):
                plane.update(np.full(plane.buffer_size, value, np.uint8).tobytes())
            rows = np.zeros((32, frame.planes[0].line_size), np.uint8)
            rows[:, : len(luma)], rows[:, len(luma) : 256] = luma, black
            frame.planes[0].update(rows.tobytes())
            frame.pts, frame.time_base, frame.color_range = i, Fraction(1, 10), 2 if full_range else 1
            stream.codec_context.color_range = frame.color_range
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
    with open_frames(tmp_path / "v.mkv", FrameOptions(tone="linear", ends=True)) as source:
        (block,) = source.blocks()
    assert source.about["bits"] == 8
    light = block.image[1, 16, : len(luma)]
    np.testing.assert_allclose(light, (luma - black) / (white - black), rtol=0, atol=4 / 65535)
    ends = block.ends[1, 16, : len(luma)]
    assert (ends[0], ends[-1]) == (BLACK, FULL) and not ends[1:-1].any()


@pytest.mark.parametrize(
    ("number", "tone", "light"),
    [(18, "hlg", 0.25 / 3), (16, "pq", 0.0092246), (8, "linear", 0.5), (1, "srgb", 0.21404)],
)
def test_the_curve_is_that_of_which_the_file_tells(number, tone, light, av, tmp_path):
    """Numbers of transfer characteristics in ITU-T H.273, on a code of half of the range; --tone goes before it."""
    path, half = tmp_path / "v.mkv", (64 + 438, 512, 512)
    write_planes(av, path, "yuv420p10le", [half, half], 1, color_trc=number, color_primaries=9, colorspace=9)
    with open_frames(path) as source:
        (block,) = source.blocks()
    assert (source.about["tone"], source.about["bits"]) == (tone, 10)
    np.testing.assert_allclose(block.image, light, rtol=1e-3)
    np.testing.assert_allclose(frames_of(path, tone="gamma:2")[1], 0.25, rtol=1e-3)


@pytest.mark.parametrize(("primaries", "red"), [(1, 0.2126), (9, 0.2627)])
def test_luminance_has_the_weights_of_the_primaries(primaries, red, av, tmp_path):
    """Of ITU-R BT.709 and BT.2020, for red that is a half of full scale."""
    write_planes(av, tmp_path / "v.mkv", "gbrp10le", [(0, 0, 512)] * 2, color_trc=8, color_primaries=primaries)
    np.testing.assert_allclose(frames_of(tmp_path / "v.mkv")[1], red * 512 / 1023, rtol=1e-4)


def test_a_track_of_no_known_codec_or_size_is_named(av, tmp_path):
    """The codec of a Matroska file is a name, and its sizes are elements B0 and BA, of a byte each here."""
    write(av, tmp_path / "v.mkv", noise(3))
    good = (tmp_path / "v.mkv").read_bytes()
    (tmp_path / "v.mkv").write_bytes(good.replace(b"V_FFV1", b"V_ZZZZ"))
    with pytest.raises(FramesError, match=r"v\.mkv: .* no codec that is known here; .* converted: ffmpeg"):
        open_frames(tmp_path / "v.mkv")
    at = good.index(b"\xb0\x81\x40\xba\x81\x30")  # width 64 and height 48, of a byte each
    (tmp_path / "v.mkv").write_bytes(good[: at + 2] + b"\0" + good[at + 3 : at + 5] + b"\0" + good[at + 6 :])
    with pytest.raises(
        FramesError, match=r"v\.mkv: (its video track has no size; it is|not frames .* or) damaged"
    ):  # by release of ffmpeg
        open_frames(tmp_path / "v.mkv")


@pytest.mark.parametrize(
    "matrix, corner", [((0, 1, -1, 0), (0, -1)), ((-1, 0, 0, -1), (-1, -1)), ((0, -1, 1, 0), (-1, 0))]
)
def test_the_picture_is_turned_as_players_turn_it(matrix, corner, av, tmp_path):
    """The matrix of the track's header (ISO 14496-12, 8.3.2: x' = a x + c y, y' = b x + d y) takes the bright first
    corner, at the upper left, to another one: a telephone that was held upright writes such files."""
    frames = np.zeros((3, 32, 64, 3), np.uint8)
    frames[:, :8, :8] = 255
    write(av, tmp_path / "v.mp4", frames, codec="mpeg4", pixels="yuv420p")
    file = bytearray((tmp_path / "v.mp4").read_bytes())
    at = file.index(b"tkhd") + 44  # of a header of version 0
    a, b, c, d = (65536 * n for n in matrix)
    file[at : at + 36] = struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 1 << 30)
    (tmp_path / "v.mp4").write_bytes(file)
    with open_frames(tmp_path / "v.mp4") as source:
        images = np.concatenate([block.image for block in source.blocks()])
        assert (source.width, source.height) == ((32, 64) if matrix[0] == 0 else (64, 32))
    bright = [where for where in ((0, 0), (0, -1), (-1, 0), (-1, -1)) if images[(0, *where)] > 0.8]
    assert images.shape == (3, source.height, source.width) and bright == [corner]


@pytest.mark.parametrize("name, codec, pixels", [("v.mkv", "ffv1", "bgr0"), ("v.mp4", "mpeg4", "yuv420p")])
@pytest.mark.parametrize("times", [[0, 10, 20, 30], [0]])
def test_a_last_frame_that_stays_is_no_truncation(times, name, codec, pixels, av, tmp_path):
    """Recordings of a screen at rest have a last frame that lasts for long, as its packet says: 5 s here."""
    from fractions import Fraction

    with av.open(str(tmp_path / name), "w") as file:
        stream = file.add_stream(codec, rate=100)
        stream.height, stream.width, stream.pix_fmt = 48, 64, pixels
        packets = []
        for image, time in zip(noise(4), times):
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts, frame.time_base = time, Fraction(1, 100)
            packets += stream.encode(frame)
        packets += stream.encode()
        packets[-1].duration = 500
        file.mux(packets)
    assert frames_of(tmp_path / name)[0].tolist() == [time * 10_000_000 for time in times]


def test_a_late_first_frame_is_no_truncation(av, tmp_path):
    """The header of Matroska counts from 0: 50.03 s for three frames from 50 s on. What is cut still is."""
    write(av, tmp_path / "v.mkv", noise(30), times=range(5000, 5030))
    assert frames_of(tmp_path / "v.mkv")[0].tolist() == [i * 10_000_000 for i in range(30)]
    (tmp_path / "c.mkv").write_bytes((tmp_path / "v.mkv").read_bytes()[: (tmp_path / "v.mkv").stat().st_size // 2])
    with pytest.raises(FramesError, match=r"c\.mkv: truncated"):
        frames_of(tmp_path / "c.mkv")


def test_a_lossless_video_is_its_frames(av, tmp_path):
    """FFV1 in RGB: every code, at the times of the file, counted from its first frame."""
    frames = noise(40)
    times = np.cumsum(np.random.default_rng(8).integers(1, 6, 40))
    write(av, tmp_path / "v.mkv", frames, times=times.tolist())
    t, luminance = frames_of(tmp_path / "v.mkv", tone="linear", white=255)
    # Matroska keeps ms
    assert t.tolist() == [int(n) * 10_000_000 for n in times - times[0]]
    np.testing.assert_allclose(luminance, frames @ [0.2126, 0.7152, 0.0722], rtol=4e-7)
    t, rgb = frames_of(tmp_path / "v.mkv", tone="linear", white=255, colour=True, fps=3)
    np.testing.assert_allclose(t, np.arange(40) / 3 * 1e9, atol=0.51)
    np.testing.assert_allclose(rgb, frames, rtol=2e-7)


@pytest.mark.parametrize(("height", "matrix"), [(48, (0.299, 0.587, 0.114)), (720, (0.2126, 0.7152, 0.0722))])
def test_colours_of_a_compressed_video(av, tmp_path, height, matrix):
    """Y'CbCr by ITU-R BT.601 below 720 lines and BT.709 from there, where the file does not say."""
    luma, blue, red = 100 / 255, 20 / 255, -30 / 255
    kr, kg, kb = matrix
    r, b = luma + 2 * (1 - kr) * red, luma + 2 * (1 - kb) * blue
    expected = np.array([r, (luma - kr * r - kb * b) / kg, b])
    chroma = [np.full(height // 2 * 32, round(128 + 224 * c)) for c in (blue, red)]
    frame = np.concatenate([np.full(height * 64, round(16 + 219 * luma)), *chroma]).astype(np.uint8)
    with av.open(str(tmp_path / "v.mkv"), "w") as file:
        stream = file.add_stream("ffv1", rate=10)
        stream.height, stream.width, stream.pix_fmt = height, 64, "yuv420p"
        for packet in stream.encode(av.VideoFrame.from_ndarray(frame.reshape(height * 3 // 2, 64), format="yuv420p")):
            file.mux(packet)
        for packet in stream.encode():
            file.mux(packet)
    rgb = frames_of(tmp_path / "v.mkv", tone="linear", colour=True)[1]
    # two roundings to whole codes
    np.testing.assert_allclose(rgb[0, 8, 8], expected, atol=2.1 / 255)


@pytest.mark.parametrize(("name", "codec", "pixels"), [("v.mkv", "ffv1", "bgr0"), ("v.avi", "mjpeg", "yuvj420p")])
def test_a_cut_video_is_an_error_after_its_good_frames(av, tmp_path, name, codec, pixels):
    """Decoders end a cut file without a word; the length in the header tells."""
    frames = noise(50)
    write(av, tmp_path / name, frames, codec=codec, pixels=pixels)
    whole = (tmp_path / name).read_bytes()
    expected = frames_of(tmp_path / name)[1]
    assert len(expected) == 50
    for share in (0.3, 0.9):
        (tmp_path / name).write_bytes(whole[: int(share * len(whole))])
        seen = []
        with open_frames(tmp_path / name) as source, pytest.raises(FramesError, match="truncated"):
            for block in source.blocks():
                seen.append(block.image)
        got = np.concatenate(seen)
        assert 2 < len(got) < 50
        np.testing.assert_array_equal(got, expected[: len(got)])


@pytest.mark.parametrize(
    ("name", "codec", "pixels"),
    [("v.mkv", "ffv1", "bgr0"), ("v.avi", "mjpeg", "yuvj420p"), ("v.mp4", "mpeg4", "yuv420p")],
)
def test_a_video_that_is_cut_in_its_second_frame_is_an_error(av, tmp_path, name, codec, pixels):
    """A single frame has no distance from another: the header's rate tells how long it is. One alone is whole."""
    path = tmp_path / name
    write(av, path, noise(1), codec=codec, pixels=pixels)
    assert len(frames_of(path)[1]) == 1
    write(av, path, noise(10), codec=codec, pixels=pixels)
    with av.open(str(path)) as file:
        packets = [(packet.pos, packet.size) for packet in file.demux(file.streams.video[0]) if packet.size]
    begin, size = packets[1]
    path.write_bytes(path.read_bytes()[: begin + size // 2])
    with pytest.raises(FramesError, match=r"truncated.*frame [01]\b"):
        frames_of(path)


def test_no_video(av, tmp_path):
    """Text, and a header cut short."""
    (tmp_path / "v.mp4").write_text("no video at all, but a long enough text to look at")
    with pytest.raises(FramesError, match=r"v\.mp4: not frames that can be read"):
        open_frames(tmp_path / "v.mp4")
    write(av, tmp_path / "w.mkv", noise(3))
    (tmp_path / "w.mkv").write_bytes((tmp_path / "w.mkv").read_bytes()[:300])
    with pytest.raises(FramesError, match=r"w\.mkv"):
        frames_of(tmp_path / "w.mkv")


def test_a_name_with_a_colon(av, tmp_path, monkeypatch):
    """Named as the moment it was taken: FFmpeg took what stands before the colon for a protocol."""
    write(av, tmp_path / "a.mkv", noise(3))
    for name in ("b.mkv", "2024-01-01T12:30:00.mkv"):
        shutil.copy(tmp_path / "a.mkv", tmp_path / name)
    monkeypatch.chdir(tmp_path)
    np.testing.assert_array_equal(frames_of("2024-01-01T12:30:00.mkv")[1], frames_of(tmp_path / "b.mkv")[1])


@pytest.mark.parametrize("name", ["list.m3u8", "list.mp4"])
def test_a_list_of_other_files_is_refused(name, av, tmp_path):
    """By what is in it: FFmpeg would read any file that it names."""
    (tmp_path / "outside").mkdir()
    write(av, tmp_path / "outside" / "a.ts", noise(3), codec="mpeg2video", pixels="yuv420p", rate=25)
    text = "ffconcat version 1.0\nfile outside/a.ts\n"
    if name.endswith(".m3u8"):
        place = tmp_path / "outside" / "a.ts"
        text = f"#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:0.4,\n{place}\n#EXT-X-ENDLIST\n"
    (tmp_path / name).write_text(text)
    with pytest.raises(FramesError, match=rf"{name}: a list of other files \((hls|concat)"):
        open_frames(tmp_path / name)
