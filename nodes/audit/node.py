"""Runs the audit of a camera as a node: frames and states in, the error of its events so far out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from evis.config.params import Param
from evis.runtime.node import Input, Node, Output
from evis.scene.digest import whole
from evis.scene.parameters import SCENE, camera_of, ends_alone, scene_of, worlds_of
from msgs.audit import Audit as AuditMessage
from msgs.camera import Frames, Keyframe, Samples
from msgs.header import Header, Message
from msgs.own_time import ORIGIN
from msgs.world import WorldState
from nodes.event_sensor.parameters import NODE, PRESET, source_of
from nodes.event_sensor.scene_parameters import resolve_with_scene
from nodes.renderer import parameters
from nodes.renderer.parameters import LIGHT

if TYPE_CHECKING:
    from nodes.audit.audit import Audit
    from nodes.event_sensor.input.further import Further

SENSOR = ("model", "threshold", "threshold_on", "threshold_off", "dark_level", "crossing", "defocus_px")
"""Parameters of the run's sensor that an audit shares with it."""

ON_GPU = "on a GPU it costs more than the run itself; audit:=64 asks for it"
"""Why there is none by default."""

SLOWEST_HZ = 1.0
"""Keyframes a second below which there is none by default: brute force looks at a pixel 500 times a second however few
frames there are, so that an audit costs the more times a run the farther these are apart."""

HORIZON_S = 1.0
"""How far ahead motion is looked at before pixels are drawn, if the run is longer [s]."""


class AuditNode(Node):
    """Keeps some pixels for an episode, and compares what is made of them with brute force."""

    PARAMS: ClassVar[Mapping[str, Param]] = {
        "audit": Param(
            int, None, "pixels that are also computed by brute force, for the error of the events in the summary; "
            "0 = none; not given = as many as cost about 3 % of the run, 16 at least where these are cheap, none on a "
            "GPU or where keyframes are more than a second apart", "", 0, 1 << 20, optional=True,
        ),
        "audit_limit": Param(
            float, 0.5, "error (Victor-Purpura, 1/ms) above which the audit warns, with the cause", "", 0, 1
        ),
        "camera": Param(str, "cam0", "which camera of the scene"),
        "colour": Param(bool, False, "frames are linear RGB, for colour events, instead of luminance"),
        "source": Param(
            str, "frames", "samples or frames (interpolator) or keyframe (K = 1), as the sensor reads",
            choices=("frames", "samples", "keyframe"),
        ),
        "seed": Param(int, 0, "seed of the choice of pixels; environment k has seed + k", "", 0, 2**63 - 1),
        "device": Param(str, "cpu", "where kernels run: cpu, cuda, cuda:1"),
        "envs": Param(int, 1, "parallel environments that are expected", minimum=1, maximum=65536),
        "keyframe_rate": Param(float, 30.0, "rate of the states, for how many pixels there are", "Hz", 1e-3, 1e6),
        "upsampling": Param(int, 8, "frames per keyframe interval (K), for the same", "", 1, 4096),
        "duration": Param(float, None, "of the run, if it is known", "s", 0, 1e9, optional=True),
        "preset": replace(PRESET, help="sensor whose thresholds to take"),
        **{name: NODE[name] for name in SENSOR},
        **{name: replace(param) for name, param in SCENE.items()},
        **LIGHT,
    }  # fmt: skip
    INPUTS: ClassVar[Mapping[str, Input]] = {
        "frames": Input("/{camera}/frames", on_device=True),
        "samples": Input("/{camera}/samples", on_device=True),
        "keyframe": Input("/{camera}/keyframe", on_device=True),
        "state": Input("/state"),
    }
    OUTPUTS: ClassVar[Mapping[str, Output]] = {"audit": Output("/{camera}/audit")}

    @classmethod
    def needs(cls, params: Mapping[str, Any], wanted: frozenset[str]) -> frozenset[str]:
        """Names the inputs: states, and the frames that the event sensor reads."""
        return frozenset({"state", _source(params)})

    @classmethod
    def reads(cls, params: Mapping[str, Any], port: str) -> frozenset[str] | None:
        """Says that of keyframes luminance will do, unless the run's events are of colours, and of motion in closed
        form its ends."""
        if port == "state":
            return ends_alone(params.get("scene"))
        if port == "frames":
            return frozenset({"rgb" if params["colour"] else "luminance"})
        return frozenset({"radiance" if params["colour"] else "luminance"}) if port == "keyframe" else None

    @classmethod
    def without_effect(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Names the parameters of paths, where there are none, and those of the sensor that it has no use for
        either."""
        from nodes.event_sensor.effects import without_effect

        idle = without_effect(resolve_with_scene("audit", params))
        return dict(parameters.without_effect(params)) | {name: why for name, why in idle.items() if name in SENSOR}

    @classmethod
    def random(cls, params: Mapping[str, Any]) -> tuple[str, ...]:
        """Names what is drawn at random."""
        return ("which pixels are audited",)

    @classmethod
    def pointless(cls, params: Mapping[str, Any]) -> str:
        """Says why an audit is left out: every picture is the same, or it costs more than the run, on a GPU or where
        keyframes are far apart, and nobody asked for it."""
        if params.get("audit") is None and str(params.get("device", "cpu")).startswith("cuda"):
            return ON_GPU
        rate = params.get("keyframe_rate")
        if params.get("audit") is None and rate is not None and rate < SLOWEST_HZ:
            return f"it costs more than a run whose keyframes are {1 / rate:g} s apart; audit:=16 asks for it"
        from evis.scene.load import is_dynamic, load_scene, parse_args
        from nodes.audit.causes import nothing_changes

        scene = params.get("scene")
        try:
            if not scene or is_dynamic(scene) or not nothing_changes(scene_of("audit", params, visuals=False)):
                return ""
            still = nothing_changes(load_scene(scene, parse_args(params.get("scene_args")), textures=False))
        except (ValueError, OSError):
            # Whoever loads the scene says what is wrong with it.
            return ""
        return "nothing moves and no light flickers, so there are no events to be wrong" if still else ""

    def setup(self) -> None:
        """Makes the audit, and compiles what it needs."""
        from nodes.audit.audit import Audit, AuditOptions
        from nodes.audit.budget import Rates, pixels_for

        p = self.params
        self._source = _source(p)
        self._scene, alike = worlds_of(self.name, p).groups(whole)[0]
        # Those from 0 on that have its world: further ones are never looked at.
        envs = int(np.cumprod(alike == np.arange(len(alike))).sum())
        if envs < p["envs"]:
            self.warn(f"environments have worlds of their own: of {p['envs']} the first {envs} are audited")
        camera = camera_of(self._scene, p["camera"])
        samples = p["supersampling"] or camera.supersampling
        light = parameters.light_options(p)
        sensor = resolve_with_scene(self.name, p)
        pixels = p["audit"]
        if pixels is None:
            rates = Rates(camera.rate or p["keyframe_rate"], p["upsampling"])
            paths = light["paths"].samples * (1 + light["paths"].bounces) if "paths" in light else 0
            pixels = pixels_for(self._scene, camera, rates, envs, samples, light["light_samples"], paths)
        horizon = round(1e9 * min(p["duration"] or HORIZON_S, HORIZON_S))
        self._between = self._source == "samples"
        options = AuditOptions(
            pixels, envs, p["seed"], sensor, horizon, samples, device=p["device"], between=self._between, **light
        )  # fmt: skip
        self._audit: Audit = Audit(self._scene, camera, options)
        self._audit.prepare()
        self._header = Header(0)
        self._warned = self._ended = False

    def state(self) -> Any:
        """Raises ValueError: brute force goes over a run as a whole."""
        raise ValueError(f"{self.name} compares a run as a whole, and keeps no state: leave audit out of the outputs")

    def update(self, inputs: Mapping[str, Message]) -> None:
        """Takes the frames of a gap."""
        message, state = inputs[self._source], inputs["state"]
        assert isinstance(message, Keyframe | Frames | Samples) and isinstance(state, WorldState)
        if message.own is not None:
            self._end(message.own)
            return
        header = message.header
        if header.stamp_ns <= self._header.stamp_ns:
            self._audit.finish()  # time has gone back to begin an episode
        self._header = Header(header.stamp_ns, clock=header.clock, episode=header.episode)
        if isinstance(message, Keyframe):
            image: Any = message.image
            frames = image.reshape((image.shape[0], 1, *image.shape[1:]))
            given = (frames, np.array([header.stamp_ns]), message.episodes, state, message.margin)
        else:
            frames = message.rgb if message.luminance is None else message.luminance
            given = (frames, message.t, message.episodes, state, 0)
        if self._audit.push(*given, _further_of(message)):
            self._publish()

    def _end(self, own: np.ndarray) -> None:
        """Ends the audit: environments reset in mid-run have times of their own, which brute force does not follow."""
        if not self._ended:
            self.finish()
            self._ended = True
            self.warn(f"the audit ends at {self._header.stamp_ns * 1e-9:g} s, for {_who_is_reset(own)}")

    def finish(self) -> None:
        """Reports the last estimate."""
        if self._ended:
            return
        self._audit.finish()
        if self._header.stamp_ns:
            self._publish()

    def _publish(self) -> None:
        from nodes.audit.causes import cause_of

        report = self._audit.report()
        cause = cause_of(self._scene, self.params["camera"], report, self._source)
        worst = np.array([w[:3] for w in report.worst], np.int32).reshape(-1, 3)
        message = AuditMessage(self._header, worst, np.array([w[3] for w in report.worst], np.float64))
        message.pixels, message.events, message.cause = report.pixels, report.total, cause
        message.vp, message.vp_low, message.vp_high = report.vp.value, report.vp.low, report.vp.high
        message.events_wrong = report.wrong.value
        message.vp_frames = report.frames if self._between else float("nan")
        self.publish("audit", message)
        totals = {"audit_pixels": report.pixels, "audit_events": report.total, "nonfinite_looks": report.nonfinite}
        if report.events:
            totals |= {"vp": message.vp, "vp_low": message.vp_low, "vp_high": message.vp_high}
            totals["events_wrong"] = message.events_wrong
            if self._between:
                totals["vp_frames"] = message.vp_frames
        for name, total in totals.items():
            self.count_total(name, total)
        if report.events and message.vp_low > self.params["audit_limit"] and not self._warned:
            self._warned = True
            self.warn(
                f"error {message.vp:.2f} ({message.vp_low:.2f} to {message.vp_high:.2f}) is above audit_limit "
                f"{self.params['audit_limit']:g}: {cause}"
            )


def _further_of(message: Keyframe | Frames | Samples) -> Further | None:
    """The samples of single pixels between the frames, where the message has any."""
    if not isinstance(message, Samples) or not message.offset.size:
        return None
    from nodes.event_sensor.input.further import Further

    return Further(message.first, message.offset, message.further_rgb if message.further is None else message.further)


def _source(params: Mapping[str, Any]) -> str:
    """The input port: that of the sensor."""
    return source_of(params["source"], lambda: resolve_with_scene("audit", params))


def _who_is_reset(own: np.ndarray) -> str:
    """Says which environments are reset while the clock goes on. own: rows of `msgs.own_time`."""
    if len(own) == 1:
        return "the environment is reset while the run goes on"
    together = bool((own[:, ORIGIN] == own[0, ORIGIN]).all())
    return "all environments are reset while the run goes on" if together else "an environment is reset by itself"
