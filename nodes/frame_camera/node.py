"""Runs the frame camera as a node: frames between keyframes in, images of a simulated frame sensor out."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from evis.config.params import Param
from evis.runtime.node import Input, Node, Output
from evis.scene.parameters import SCENE, foreseen_worlds, seeds_of
from evis.scene.sampling import undersampled
from msgs.camera import Frames, Image, Keyframe
from msgs.header import Header, Message
from msgs.own_time import STAMP, rows_of_shared_time
from nodes.frame_camera.parameters import AUTO, NODE, PRESET, settings_of

if TYPE_CHECKING:
    from nodes.frame_camera.camera import FrameCamera
    from nodes.frame_camera.parameters import Settings


class FrameCameraNode(Node):
    """Publishes an image when its exposure has ended, one for each environment, stamped with the exposure's middle."""

    PARAMS: ClassVar[Mapping[str, Param]] = {
        "camera": Param(str, "cam0", "which camera of the scene"),
        "source": Param(
            str, "frames", "frames (interpolator) or keyframe (renderer, K = 1)", choices=("frames", "keyframe")
        ),
        "preset": PRESET,
        "seed": Param(int, 0, "seed of the images' noise; environment k has seed + k", "", 0, 2**63 - 1),
        "device": Param(str, "cpu", "where kernels run: cpu, cuda, cuda:1"),
        "colour": Param(bool, False, "images in colour, from frames that are, instead of grey"),
        "scene": SCENE["scene"],
        "scene_args": SCENE["scene_args"],
        "frame_rate": Param(
            float,
            0.0,
            "rate of frames, to warn of what is too fast for them; 0 = the renderer warns",
            "Hz",
            0,
        ),
        "defocus_px": Param(float, None, "standard deviation of the lens's blur", "px", 0, 50, optional=True),
        **NODE,
    }
    INPUTS: ClassVar[Mapping[str, Input]] = {
        "frames": Input("/{camera}/frames", on_device=True),
        "keyframe": Input("/{camera}/keyframe", on_device=True),
    }
    OUTPUTS: ClassVar[Mapping[str, Output]] = {"image": Output("/{camera}/image")}

    @classmethod
    def without_effect(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Names the parameters of auto-exposure, where the exposure is given."""
        return {} if params["exposure_ms"] is None else dict.fromkeys(AUTO, "exposure_ms gives the exposure")

    @classmethod
    def random(cls, params: Mapping[str, Any]) -> tuple[str, ...]:
        """Names the noise that the parameters ask for, which the seed decides."""
        sensor = settings_of("frame camera", params["preset"], _own(params)).sensor
        return tuple(what for name, what in RANDOM.items() if sensor[name])

    @classmethod
    def foreseen(cls, params: Mapping[str, Any]) -> tuple[str, ...]:
        """Names what is too fast for frames, of which single pixels between them tell the events alone."""
        if not params["frame_rate"] or not params["scene"]:
            return ()
        # Whoever shows the scene says what is wrong with it.
        with contextlib.suppress(ValueError, OSError):
            worlds = foreseen_worlds("frame camera", params)
            return tuple(f"images are of frames alone: {line}" for line in undersampled(worlds, params["frame_rate"]))
        return ()

    @classmethod
    def needs(cls, params: Mapping[str, Any], wanted: frozenset[str]) -> frozenset[str]:
        """Names the input that is read: frames where an interpolator runs, keyframes where it is left out."""
        return frozenset({params["source"]})

    @classmethod
    def reads(cls, params: Mapping[str, Any], port: str) -> frozenset[str] | None:
        """Says that of keyframes luminance will do, unless images are in colour, and that nobody needs the frames'
        counts."""
        if port == "frames":
            return frozenset({"rgb" if params["colour"] else "luminance"})
        return frozenset({"radiance" if params["colour"] else "luminance"}) if port == "keyframe" else None

    def setup(self) -> None:
        """Compiles the kernels, by an image of a pixel."""
        from evis.gpu.devices import device_named

        self._device = device_named(self.params["device"])
        self._settings = settings_of(self.name, self.params["preset"], _own(self.params))
        for line in self.foreseen(self.params):
            self.warn(line)
        self._forget()
        # How long its rows take to read out says nothing of those of the frames.
        still = replace(self._settings, line_delay_ns=0)
        tiny = self._made(still, 1, (2, 2, 3 if self.params["colour"] else 1))
        end = self._settings.phase_ns + 2 * self._settings.longest
        for stamp, anew in ((0, True), (end, False)):
            images = np.ones((1, 1, 2, 2, 3 if self.params["colour"] else 1), np.float32)
            tiny.push(images, np.full((1, 1), stamp), np.array([anew]), np.zeros((1, 4), np.int64))

    def _forget(self) -> None:
        self._camera: FrameCamera | None = None
        self._last: Header | None = None
        self._episodes = np.zeros(0, np.int32)

    def _made(self, settings: Settings, envs: int, shape: tuple[int, int, int]) -> FrameCamera:
        from nodes.frame_camera.camera import FrameCamera

        p = self.params
        seeds = seeds_of({**p, "envs": envs})
        return FrameCamera(settings, seeds, shape, p["device"], p["defocus_px"] or 0.0, self.below(p["camera"]))

    def rewind(self, params: Mapping[str, Any]) -> bool:
        """Begins anew; only the seed may differ."""
        if {**params, "seed": 0} != {**self.params, "seed": 0}:
            return False
        self.params = dict(params)
        self._forget()
        self.restart_totals()
        return True

    def state(self) -> Any:
        """Gives the light that open exposures have gathered, and when exposures begin and end."""
        return None if self._camera is None else self._camera.state()

    def restore(self, state: Any) -> None:
        """Goes on with these exposures."""
        if self._camera is not None and state is not None:
            self._camera.restore(state)

    def update(self, inputs: Mapping[str, Message]) -> None:
        """Takes the frames of a gap."""
        message = inputs[self.params["source"]]
        assert isinstance(message, Keyframe | Frames)
        image, t = self._light(message)
        envs, episodes = len(message.episodes), np.array(message.episodes)
        rows = rows_of_shared_time(episodes, message.header.stamp_ns) if message.own is None else np.array(message.own)
        own_t = message.own_t if isinstance(message, Frames) else None
        if own_t is None:
            own_t = rows[:, [STAMP]] if message.own is not None else np.broadcast_to(t, (envs, len(t)))
        if self._camera is None:
            height, width = image.shape[2:4]
            shape = (int(height), int(width), 3 if self.params["colour"] else 1)
            self._camera = self._made(self._settings, envs, shape)
        anew = episodes != self._episodes if len(self._episodes) else np.ones(envs, bool)
        anew |= self._interrupted(message.header)
        self._episodes, self._last = episodes, message.header
        for shot in self._camera.push(image, own_t, anew, rows):
            self._publish(shot, envs)
        self._count()

    def _interrupted(self, header: Header) -> bool:
        """Whether frames are missing before these, as they may be where they are only looked at, or time goes back."""
        last = self._last
        return last is not None and (header.seq > last.seq + 1 or header.stamp_ns < last.stamp_ns)

    def _publish(self, shot: Any, envs: int) -> None:
        assert self._last is not None
        encoding = ("rgb" if shot.pixels.shape[2] == 3 else "mono") + ("8" if shot.pixels.dtype == np.uint8 else "16")
        data = self.loan("image", data=(shot.pixels.shape, shot.pixels.dtype))["data"]
        data[...] = shot.pixels
        header = Header(shot.stamp_ns, clock=self._last.clock, episode=self._last.episode)
        image = Image(header, data, encoding, shot.exposure_ns, self._settings.line_delay_ns, shot.env, envs)
        self.publish("image", image)

    def _count(self) -> None:
        assert self._camera is not None
        camera = self._camera
        self.count_total("clipped_pixels", camera.clipped)
        self.count_total("exposures_cut_off", camera.cut_off)
        if self.count_total("nonfinite_pixels", camera.nonfinite):
            self.warn(f"{camera.nonfinite} pixels of images have light that is not finite; they are black or saturated")

    def finish(self) -> None:
        """Reports how many exposures the end of the run leaves without an image."""
        if self._camera is not None and self._camera.unfinished:
            self.count("unfinished_exposures", self._camera.unfinished)

    def _light(self, message: Keyframe | Frames) -> tuple[Any, np.ndarray]:
        """Frames [E, K, H, W(, 3)] and their stamps int64 [K] ns, of a keyframe K = 1, without its margin."""
        colour = self.params["colour"]
        if isinstance(message, Frames):
            image = message.rgb if colour else message.luminance
            if image is None:
                want, have = ("rgb", "luminance") if colour else ("luminance", "rgb")
                raise ValueError(f"{self.name}: frames carry {have}, images need {want}; set colour alike on both")
            return image, message.t
        from nodes.interpolator.luminance import as_frame

        if colour and message.radiance is None:
            raise ValueError(f"{self.name}: keyframes carry luminance, colour needs their radiance (keyframes:=rgb)")
        frame = as_frame(message.image, message.margin, colour, self._device)
        return frame, np.array([message.header.stamp_ns])


RANDOM = {"photon_noise": "photon noise of images", "read_noise": "read noise of images"}
"""Parameters -> what they turn on that is random."""


def _own(params: Mapping[str, Any]) -> dict[str, Any]:
    """Those of the frame camera proper."""
    return {name: params.get(name) for name in NODE}
