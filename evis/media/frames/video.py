"""Reads frames of a video file, decoded by PyAV (the optional extra `video`) and made linear by an inverse tone
curve."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from evis.files.allowance import Allowance
from evis.files.damage import faults_as
from evis.media.colour import REC709
from evis.media.ffmpeg import address
from evis.media.frames.ends import ends_of
from evis.media.frames.source import PIXEL_BYTES, FrameOptions, FramesError, ImageSource, NamedImage
from evis.media.frames.tone import REC2020, Tone, shaped

_BT709, _BT601, _UNKNOWN = 1, 5, 2
"""Numbers of colour spaces in ITU-T H.273, which video files and ffmpeg use."""
_HD = 720
LISTS = frozenset(("hls", "applehttp", "dash", "concat", "sdp", "rtsp", "imf", "mlv"))
"""Formats of FFmpeg's that lead to other files, whatever the name of the one that says so ends in."""
_BT2020 = 9
"""Number of these primaries in ITU-T H.273."""
_TOLD_TONES = {8: "linear", 16: "pq", 18: "hlg"}
"""Transfer characteristics of ITU-T H.273 -> tone curve. Others are near to `srgb`, and taken for it."""
_FULL_RANGE = 2
"""Number of the range of codes in which luma goes from 0 to the largest one, in ffmpeg."""


class VideoFrames(ImageSource):
    """Reads the first video track. Times are the file's, counted from its first frame, or those of --fps."""

    kind = "video"

    def __init__(self, path: Path, options: FrameOptions) -> None:
        try:
            import av
        except ImportError:
            raise FramesError(
                f"{path}: reading videos needs PyAV: pip install 'evis[video]', or give a folder of PNG and --fps"
            ) from None
        self._path, self._options = path, options
        self._error = av.error.FFmpegError
        try:
            self._file = av.open(address(path))
        except (av.error.FFmpegError, OSError, ValueError) as error:
            raise FramesError(f"{path}: not frames that can be read, or damaged: {_text(error)}") from None
        if LISTS.intersection(self._file.format.name.split(",")):
            kind = self._file.format.name
            self._file.close()
            raise FramesError(f"{path}: a list of other files ({kind}), not a video; give the video itself")
        if not self._file.streams.video:
            self._file.close()
            raise FramesError(f"{path}: has no video track")
        self._track = self._file.streams.video[0]
        # of a codec that is not known here a track has nothing, not even a size
        lacks = "codec that is known here" if self._track.codec_context is None else ""
        lacks = lacks or ("" if self._track.width > 0 and self._track.height > 0 else "size")
        if lacks:
            self._file.close()
            raise FramesError(
                f"{path}: its video track has no {lacks}; it is damaged, or to be converted: ffmpeg -i IN OUT.mp4"
            )
        self._track.thread_type = "NONE"
        self.width, self.height = self._track.width, self._track.height
        Allowance(path.stat().st_size).check(self.width * self.height * PIXEL_BYTES)
        first = self._first_frame(av)
        # By how many quarters of a turn, counter-clockwise, players turn the picture: telephones held upright say so.
        self._turns = 0 if first is None else round(first.rotation / 90) % 4
        self._tone = self.tone = self._told_tone(first)
        if self._turns % 2:
            self.width, self.height = self.height, self.width
        self.channels, self.count = 3 if options.colour else 1, self._track.frames or None
        self.about = {"tone": self._tone.name, "white": self._tone.white}

    def _first_frame(self, av: Any) -> Any:
        """The first frame of a second reading of the file, None where it cannot be decoded: only a decoded frame tells
        how the picture is turned, and of codes all that the file says of them."""
        try:
            with av.open(address(self._path)) as file:
                return next(file.decode(video=0), None)
        except (self._error, OSError, ValueError):
            return None

    def _told_tone(self, first: Any) -> Tone:
        """The curve that is asked for, or else that of which the first frame tells."""
        if first is None:
            return self._options.make_tone()
        weights = REC2020 if int(first.color_primaries) == _BT2020 else REC709
        return self._options.make_tone(_TOLD_TONES.get(int(first.color_trc), "srgb"), weights)

    def _images(self) -> Iterator[NamedImage]:
        first: Fraction | None = None
        end = shown = Fraction(0)
        index = 0
        for frame in self._frames():
            name = f"{self._path}, frame {index}"
            if frame.pts is None and not self._options.fps:
                raise FramesError(f"{name}: the file tells no time for it; give --fps")
            at = Fraction(frame.pts or 0) * (frame.time_base or 0)
            first = at if first is None else first
            end, shown = at - first, Fraction(frame.duration or 0) * (frame.time_base or 0)
            if frame.interlaced_frame:
                self.about["interlaced_frames"] = self.about.get("interlaced_frames", 0) + 1
            t = self._options.stamp(index) if self._options.fps else round(end * 1_000_000_000)
            with faults_as(FramesError, name):
                codes, white = self._codes(frame)
                image = shaped(codes, self._tone, self.channels == 3, white)
                ends = ends_of(codes, white) if self._options.ends else None
            yield NamedImage(name, t, image, ends)
            index += 1
        self._check_end(index, end, shown)

    def _frames(self) -> Iterator[Any]:
        """Decoded frames, also those that the decoder still holds at damage; then raises FramesError."""
        index, damage = 0, ""
        packets = self._file.demux(self._track)
        while not damage:
            try:
                packet = next(packets, None)
                if packet is None:
                    return
                damage = "a packet is incomplete" if packet.is_corrupt else ""
                frames = self._track.codec_context.decode(None) if damage else packet.decode()
            except self._error as error:
                frames, damage = [], _text(error)
            for frame in frames:
                if frame.is_corrupt and not damage:
                    damage = "it is damaged"
                    break
                yield frame
                index += 1
        raise FramesError(f"{self._path}: truncated or damaged at frame {index}: {damage}")

    def _check_end(self, frames: int, end: Fraction, shown: Fraction) -> None:
        """Raise where the video is clearly shorter than its header says: decoders end a cut file without a word.

        end, shown: when the last frame comes and for how long [s], as its packet says; 0 where it does not.
        """
        if not frames:
            raise FramesError(f"{self._path}: no frame can be decoded")
        told = self._told()
        if told is None:
            return
        if frames > 1:
            period = end / (frames - 1)
        elif self.count == 1 or not self._track.average_rate:
            return
        else:
            period = 1 / Fraction(self._track.average_rate)
        if told - (end + max(period, shown)) > max(2 * period, told / 100):
            raise FramesError(
                f"{self._path}: truncated: it ends after {float(end + max(period, shown)):.3f} s (frame {frames - 1}), "
                f"its header says {float(told):.3f} s"
            )

    def _told(self) -> Fraction | None:
        """Length of the track by the header [s], None where it does not say."""
        track = self._track
        if track.duration is not None and track.time_base is not None:
            return Fraction(track.duration) * track.time_base
        if self._file.duration is not None and len(self._file.streams) == 1:
            # that of Matroska counts from 0, not from the first frame
            return Fraction(self._file.duration - max(self._file.start_time or 0, 0), 1_000_000)
        return None

    def _codes(self, frame: Any) -> tuple[np.ndarray, int | None]:
        """Codes of R, G and B [H, W, 3], turned, and that of white; None = the largest one."""
        components = frame.format.components
        bits = max(component.bits for component in components)
        has_chroma = len(components) > 2 and not frame.format.is_rgb
        # FFmpeg's ways from luma and chroma of 8 bits to packed RGB cut off up to a code, of 8 bits or of 16
        way = "gbrp16le" if has_chroma else "rgb48le" if bits > 8 else "rgb24"
        # what the file leaves open is Rec. 709 in HD and Rec. 601 below, as players take it
        space = int(frame.colorspace)
        source = (_BT709 if frame.height >= _HD else _BT601) if space == _UNKNOWN else None
        self.about["bits"] = min(bits, 16)
        codes: np.ndarray = frame.to_ndarray(format=way, src_colorspace=source)
        codes = np.ascontiguousarray(np.rot90(codes, self._turns)) if self._turns else codes
        return codes, None if way == "rgb24" else _deep_white(frame)

    def close(self) -> None:
        self._file.close()


def _text(error: BaseException) -> str:
    return str(getattr(error, "strerror", None) or error) or type(error).__name__


def _deep_white(frame: Any) -> int:
    """The code that FFmpeg's conversion to RGB of 16 bits gives what is white in a frame.

    Luma of a limited range becomes 255 of 256 parts. What has the full range, as grey has, is shifted up to 16 bits.
    """
    components = frame.format.components
    if frame.format.is_rgb:
        return 0xFFFF
    if len(components) > 2 and int(frame.color_range) != _FULL_RANGE:
        return 0xFF00
    bits = max(component.bits for component in components)
    return 0xFFFF if bits > 16 else (2**bits - 1) << (16 - bits)
