"""The renderer node: world states in, keyframe images of one camera out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from evis.config.params import Param
from evis.runtime.node import Input, Node, Output
from msgs.camera import CameraInfo, Depth, Ids, Keyframe, Motion, Normal
from msgs.header import Header, Message
from msgs.world import WorldState

if TYPE_CHECKING:
    from nodes.renderer.renderer import Renderer
    from nodes.renderer.supersampling import SupersampledRenderer

GEOMETRIC: dict[str, Any] = {"depth": Depth, "motion": Motion, "ids": Ids, "normal": Normal}
"""Outputs besides the keyframe, which are called as the array of their message is."""


class RendererNode(Node):
    """Renders a keyframe for every world state, with the images that somebody reads."""

    PARAMS = {
        "scene": Param(str, "spinning_disk", "scene by name, or its file"),
        "scene_args": Param(str, "", "the scene's own arguments, key=value,key=value"),
        "camera": Param(str, "cam0", "which camera of the scene"),
        "device": Param(str, "cpu", "cpu, cuda or cuda:N"),
        "envs": Param(int, 1, "parallel environments", minimum=1, maximum=65536),
        "width": Param(int, 0, "image width, 0 = the scene's", "px", 0, 8192),
        "height": Param(int, 0, "image height, 0 = the scene's", "px", 0, 8192),
        "margin": Param(int, 0, "pixels rendered beyond every side of the image", "px", 0, 1024),
        "threads": Param(int, 1, "CPU threads", minimum=1, maximum=256),
        "half": Param(bool, False, "keyframes as float16, clipped at 65504"),
        "keyframes": Param(
            str,
            "auto",
            "rgb, luminance, or auto: luminance while nobody reads colour",
            choices=("auto", "rgb", "luminance"),
        ),
        "supersampling": Param(int, 0, "samples per pixel and axis, averaged; 0 = the camera's", minimum=0, maximum=16),
        "samples_apart": Param(bool, False, "keyframes hold the samples, for an interpolator to average what it moved"),
        "light_samples": Param(int, 16, "shadow rays for an area light and pixel, a square", minimum=1, maximum=4096),
        "bounces": Param(int, 0, "surfaces beyond the seen one over which light may come, by paths", "", 0, 63),
        "sky_occlusion": Param(bool, False, "by paths too: light of the sky that things hide, and of glowing surfaces"),
        "path_samples": Param(int, 16, "paths per pixel, where there are any", minimum=1, maximum=65536),
        "roulette": Param(bool, False, "from the second bounce on, end paths at random that carry little"),
        "keyframe_rate": Param(float, 30.0, "rate of the states, told to readers in /info", "Hz", 0),
        "frame_rate": Param(float, 0.0, "rate at which things are seen, to warn of what is too fast; 0 = any", "Hz", 0),
    }
    INPUTS = {"state": Input("/state")}
    OUTPUTS = {
        "info": Output("/{camera}/info"),
        "keyframe": Output("/{camera}/keyframe"),
        "depth": Output("/{camera}/depth"),
        "motion": Output("/{camera}/motion"),
        "ids": Output("/{camera}/ids"),
        "normal": Output("/{camera}/normal"),
    }
    renderer: Renderer | SupersampledRenderer

    @classmethod
    def without_effect(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """What is about paths, where there are none."""
        if params["bounces"] or params["sky_occlusion"]:
            return {}
        return dict.fromkeys(("path_samples", "roulette"), "no light comes by paths without bounces or sky_occlusion")

    @classmethod
    def imports(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """What a still camera sees of still things is not drawn again."""
        from evis.scene.load import is_dynamic, load_scene, parse_args

        scene, camera = params.get("scene"), params.get("camera")
        if not scene or not camera:
            return {}
        try:
            if is_dynamic(scene):
                return {}
            bodies = load_scene(scene, parse_args(params.get("scene_args") or ""), visuals=False).bodies
        except (ValueError, OSError):
            # Whoever loads the scene says what is wrong with it.
            return {}
        still = {body.name for body in bodies if body.trajectory is not None and body.trajectory.is_static()}
        if camera not in still:
            return {}
        kept = f" and {len(still) - 1} of {len(bodies) - 1} bodies" if len(still) > 1 else ""
        return {"static background": f"{camera} never moves: the world{kept} drawn once and kept"}

    def setup(self) -> None:
        from evis.scene.load import load_scene, parse_args
        from evis.scene.stereo import baseline
        from nodes.renderer.renderer import Renderer
        from nodes.renderer.supersampling import SupersampledRenderer

        p = self.params
        size = {key: p[key] for key in ("width", "height") if p[key]}
        self.scene = load_scene(p["scene"], {**parse_args(p["scene_args"]), **size})
        try:
            camera = self.scene.camera(p["camera"])
        except KeyError as error:
            raise ValueError(error.args[0]) from None
        how = {key: p[key] for key in ("envs", "margin", "device", "threads", "half", "light_samples")}
        if p["bounces"] or p["sky_occlusion"]:
            from nodes.renderer.paths.paths import PathOptions

            how["paths"] = PathOptions(p["bounces"], p["path_samples"], p["roulette"])
        samples = p["supersampling"] or camera.supersampling
        self._fineness = samples if p["samples_apart"] else 1
        if samples > 1:
            self.renderer = SupersampledRenderer(self.scene, camera, samples, **how, apart=p["samples_apart"])
        else:
            self.renderer = Renderer(self.scene, camera, **how)
        self.renderer.prepare(self._wanted())
        self._warn_of_aliases()
        self._names = [body.name for body in self.scene.bodies]
        self._previous: np.ndarray | None = None
        self._episodes = np.zeros(0, np.int32)
        kinds = ["background", *(i.semantic or i.name for i in self.scene.instances)]
        classes = {kind: number for number, kind in enumerate(dict.fromkeys(kinds))}
        info = CameraInfo(
            Header(0),
            k=np.asarray(camera.k, np.float64),
            distortion=np.asarray(camera.distortion, np.float64),
            distortion_model=camera.distortion_model,
            name=camera.name,
            width=camera.width,
            height=camera.height,
            margin=p["margin"],
            envs=p["envs"],
            keyframe_rate=p["keyframe_rate"],
            instances=["background", *(i.name for i in self.scene.instances)],
            instance_bodies=["", *(self._names[i.body] if i.body >= 0 else "" for i in self.scene.instances)],
            semantic=np.array([classes[kind] for kind in kinds], np.int32),
            classes=list(classes),
            baseline=baseline(self.scene, camera),
            sensor=self.runtime.plan.sensor_beside(self.name, "info"),
        )
        self.publish("info", info)

    def _warn_of_aliases(self) -> None:
        from evis.scene.sampling import undersampled

        if self.params["frame_rate"]:
            for line in undersampled(self.scene, self.params["frame_rate"]):
                self.warn(line)

    def update(self, inputs: Mapping[str, Message]) -> None:
        state = inputs["state"]
        assert isinstance(state, WorldState)
        if state.names != self._names:
            raise ValueError(
                f"{self.name}: /state has bodies {', '.join(state.names)}, scene {self.scene.name} has "
                f"{', '.join(self._names)}; give both nodes the same scene and scene_args"
            )
        poses = np.array(state.end_pose)
        wanted = self._wanted()
        on_gpu = self.renderer.device.is_cuda
        out: Any = self.renderer.buffers(wanted) if on_gpu else {f: self._loan(p, f) for f, p in wanted.items()}
        self.renderer.render(poses, self._before(poses, state.episodes), out, out, state.header.stamp_ns)
        for field, port in wanted.items():
            image = self._loaned(port, field, out[field]) if on_gpu else out[field]
            self.publish(port, self._message(port, field, state, image))
        if "keyframe" in wanted.values():
            # Only now, for on a GPU this waits for the image.
            self._report()

    def _wanted(self) -> dict[str, str]:
        """What to render now, with the port that it goes to."""
        wanted = {port: port for port in GEOMETRIC if self.wants(port)}
        if self.wants("keyframe"):
            grey = self.params["keyframes"] == "luminance"
            if self.params["keyframes"] == "auto":
                grey = not self.wants("keyframe", "radiance")
            wanted["luminance" if grey else "radiance"] = "keyframe"
        return wanted

    def _before(self, poses: np.ndarray, episodes: np.ndarray) -> np.ndarray | str:
        """Poses of the previous keyframe; this one's where an environment's episode begins."""
        from nodes.renderer.renderer import LAST

        before: np.ndarray | str = LAST
        if self._previous is None:
            before = poses
        elif not np.array_equal(episodes, self._episodes):
            before = np.where((episodes == self._episodes)[:, None, None], self._previous, poses)
        self._previous, self._episodes = poses, np.array(episodes)
        return before

    def _loan(self, port: str, field: str) -> np.ndarray:
        return self.loan(port, **{field: self.renderer.array_shape(field)})[field]

    def _loaned(self, port: str, field: str, image: Any) -> Any:
        """A copy on the device: the renderer draws into the same buffers again, as graphs record where they write."""
        import warp as wp

        loan = self.loan_on(port, image.device, **{field: (image.shape, image.dtype)})[field]
        wp.copy(loan, image)
        return loan

    def _report(self) -> None:
        for name, amount in zip(("nonfinite_pixels", "clipped_pixels"), self.renderer.counts()):
            if amount:
                self.count(name, amount)

    def _message(self, port: str, field: str, state: WorldState, image: np.ndarray) -> Message:
        header = Header(state.header.stamp_ns, clock=state.header.clock, episode=state.header.episode)
        margin = self.params["margin"]
        if port == "keyframe":
            message = Keyframe(header, np.array(state.episodes), margin=margin * self._fineness)
            setattr(message, field, image)
            return message
        return GEOMETRIC[port](header, **{field: image, "margin": margin})
