"""Runs the renderer as a node: world states in, keyframe images of one camera out."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from evis.config.params import Param
from evis.gpu.in_a_row import parted
from evis.runtime.node import Input, Node, Output
from evis.scene.digest import appearance
from evis.scene.model import Scene
from evis.scene.parameters import SCENE, SEED, camera_of, ends_alone, foreseen_worlds, scene_of, seeds_of, worlds_of
from evis.scene.parts import Parts
from evis.scene.sampling import Turns, undersampled
from evis.scene.view.first_look import FirstLook
from evis.scene.worlds import Group, Worlds
from msgs.camera import CameraInfo, Depth, Ids, Keyframe, Motion, Normal
from msgs.header import Header, Message
from msgs.own_time import STAMP
from msgs.world import WorldState
from nodes.renderer import parameters
from nodes.renderer.camera_info import camera_info
from nodes.renderer.cores import threads_for
from nodes.renderer.parameters import BATCH, LIGHT

if TYPE_CHECKING:
    from nodes.renderer.renderer import Renderer
    from nodes.renderer.separate import SeparateRenderers
    from nodes.renderer.supersampling import SupersampledRenderer

GEOMETRIC: dict[str, Any] = {"depth": Depth, "motion": Motion, "ids": Ids, "normal": Normal}
"""Outputs besides the keyframe, which are called as the array of their message is."""


class RendererNode(Node):
    """Renders a keyframe for every world state, with the images that somebody reads."""

    PARAMS = {
        **SCENE,
        "seed": SEED,
        "camera": Param(str, "cam0", "which camera of the scene"),
        "device": Param(str, "cpu", "where kernels run: cpu, cuda, cuda:1"),
        "envs": Param(int, 1, "parallel environments", minimum=1, maximum=65536),
        "margin": Param(int, 0, "pixels rendered beyond every side of the image", "px", 0, 1024),
        "threads": Param(
            int,
            0,
            "CPU threads of physics, renderer and interpolator; 0 = as cores, environments and pixels are worth",
            minimum=0,
            maximum=256,
        ),
        "half": Param(bool, False, "keyframes as float16, clipped at 65504"),
        "keyframes": Param(
            str,
            "auto",
            "what keyframes hold; auto = luminance while nobody reads colour; the events are the same",
            choices=("auto", "rgb", "luminance"),
        ),
        "samples_apart": Param(bool, False, "keyframes hold the samples, for an interpolator to average what it moved"),
        **LIGHT,
        "batch": BATCH,
        "keyframe_rate": Param(float, 30.0, "rate of the states, told to readers in /info", "Hz", 0),
        "frame_rate": Param(float, 0.0, "rate at which things are seen, to warn of what is too fast; 0 = any", "Hz", 0),
        "resolved": Param(float, 0.0, "time to which single pixels are seen between frames; 0 = frames only", "s", 0),
    }
    PER_ENVIRONMENT = True
    INPUTS = {"state": Input("/state")}
    OUTPUTS = {
        "info": Output("/{camera}/info"),
        "keyframe": Output("/{camera}/keyframe"),
        "depth": Output("/{camera}/depth"),
        "motion": Output("/{camera}/motion"),
        "ids": Output("/{camera}/ids"),
        "normal": Output("/{camera}/normal"),
    }
    renderer: Renderer | SupersampledRenderer | SeparateRenderers

    @classmethod
    def without_effect(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Names the parameters of paths where there are none."""
        return parameters.without_effect(params)

    @classmethod
    def reads(cls, params: Mapping[str, Any], port: str) -> frozenset[str] | None:
        """Asks for poses at the keyframe, where nothing is moved by an engine that may turn it too fast."""
        return ends_alone(params.get("scene")) if port == "state" else None

    @classmethod
    def imports(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Names what is spared where a still camera sees still things: they are not drawn again."""
        from evis.scene.load import is_dynamic

        scene, camera = params.get("scene"), params.get("camera")
        if not scene or not camera:
            return {}
        try:
            if is_dynamic(scene):
                return {}
            bodies = scene_of("renderer", params, visuals=False).bodies
        except (ValueError, OSError):
            # Whoever loads the scene says what is wrong with it.
            return {}
        still = {body.name for body in bodies if body.trajectory is not None and body.trajectory.is_static()}
        if camera not in still:
            return {}
        kept = f" and {len(still) - 1} of {len(bodies) - 1} bodies" if len(still) > 1 else ""
        return {"static background": f"{camera} never moves: the world{kept} drawn once and kept"}

    @classmethod
    def foreseen(cls, params: Mapping[str, Any]) -> tuple[str, ...]:
        """Names the lights that flicker, and the prescribed motion that turns, too fast for the frames."""
        if params.get("scene") and params.get("frame_rate"):
            # Whoever loads the scene says what is wrong with it.
            with contextlib.suppress(ValueError, OSError):
                worlds = foreseen_worlds("renderer", params)
                return tuple(undersampled(worlds, params["frame_rate"], *_between(params)))
        return ()

    @classmethod
    def alike(cls, params: Mapping[str, Any]) -> Any:
        """Tells that renderers of the same worlds at the same rates warn of the same, whatever their cameras."""
        return {name: value for name, value in params.items() if name not in ("camera", "margin")}

    def computes_on(self) -> str:
        """Names its device."""
        return str(self.params["device"])

    def setup(self) -> None:
        """Makes the renderer, begins to compile what is wanted of it, and publishes the camera's info."""
        p = self.params
        worlds = self.worlds = worlds_of(self.name, p)
        self.scene = worlds.scenes[0]
        for note in self.scene.left_out:
            self.warn_alike(f"scene {self.scene.name}: {note}")
        samples = p["supersampling"] or camera_of(self.scene, p["camera"]).supersampling
        self._fineness = samples if p["samples_apart"] else 1
        self.gathers = self._at_once(samples)
        self.renderer = self._renderers(worlds.groups(appearance))
        self.renderer.begin(self._wanted())
        if p["frame_rate"]:
            for line in undersampled(worlds.scenes, p["frame_rate"], *_between(p)):
                self.warn_alike(line)
        self._turns = Turns(self.scene, max(p["frame_rate"], _between(p)[0]))
        self._first_look: FirstLook | None = FirstLook(self.scene)
        self._names = [body.name for body in self.scene.bodies]
        self._begin()
        self.publish("info", self._info(Header(0)))

    def warm_up(self) -> None:
        """Compiles what is wanted of the renderer."""
        self.renderer.prepare(self._wanted())

    def _at_once(self, samples: int) -> int:
        """Computes how many keyframes are rendered at once.

        Raises ValueError where they or the environments do not fit.
        """
        from nodes.renderer.at_once import at_once, check_room, keyframes_of

        p, camera = self.params, camera_of(self.scene, self.params["camera"])
        width, height = (samples * (length + 2 * p["margin"]) for length in (camera.width, camera.height))
        frames = round(p["frame_rate"] / p["keyframe_rate"])
        check_room(self.name, p["device"], p["envs"], width, height, frames)
        if not self.may_gather:
            return 1
        paths, keyframes = parameters.by_paths(p), keyframes_of(self.run_s, p["keyframe_rate"])
        how = frames, paths, keyframes, self.recorded
        count = at_once(self.name, p["batch"], p["device"], p["envs"], width * height, *how)
        if count > 1:
            self.result("batch", count)
        return count

    def _info(self, header: Header) -> CameraInfo:
        """Makes the CameraInfo of the camera in the worlds that it sees."""
        return camera_info(header, self.params, self.worlds, self.runtime.plan.sensor_beside(self.name, "info"))

    def _begin(self) -> None:
        """Stands before the first keyframe of a run."""
        self._previous: np.ndarray | None = None
        self._earlier: np.ndarray | None = None
        """Poses of the keyframe before that one."""
        self._stamp = 0
        self._episodes = np.zeros(0, np.int32)
        self._told: list[tuple[Callable[[], Sequence[int]], int, np.ndarray, Any]] = []
        """Keyframes not counted yet: what tells their counts, how many poses at the end fill up, poses, times."""
        self._new = False
        """Whether the renderer has not drawn the last keyframe, as it is another one."""

    def rewind(self, params: Mapping[str, Any]) -> bool:
        """Forgets the last keyframe, and tells of the camera as a new run does: the sensor's seed is another; what that
        draws no differently is as it was."""
        if {**params, "seed": 0} != {**self.params, "seed": 0}:
            return False
        self.params = dict(params)
        self._begin()
        self._follow(self.worlds.from_seeds(seeds_of(params)))
        self.publish("info", self._info(Header(0)))
        return True

    def state(self) -> tuple[Any, ...]:
        """Gives the poses of the last keyframe and of the one before, by which motion is told at the next."""
        return self._previous, self._earlier, self._stamp, self._episodes

    def restore(self, state: tuple[Any, ...]) -> None:
        """Knows these keyframes."""
        self._previous, self._earlier, self._stamp, self._episodes = state

    def _follow(self, worlds: Worlds) -> None:
        """Sees these worlds from now on."""
        before, self.worlds, self.scene = self.worlds, worlds, worlds.scenes[0]
        changed = worlds.changed(before, appearance)
        if len(changed):
            groups, envs = worlds.groups(appearance, changed), len(worlds.scenes)
            if len(changed) == envs:
                self.renderer = self._renderers(groups)
            else:
                from nodes.renderer.separate import SeparateRenderers

                if not isinstance(self.renderer, SeparateRenderers):
                    self.renderer = SeparateRenderers(Parts.of_all(self.renderer, envs), envs)
                self.renderer.change(groups, self._each(groups))
            self.renderer.prepare(self._wanted())

    def _renderers(self, groups: Sequence[Group]) -> Renderer | SupersampledRenderer | SeparateRenderers:
        """Makes the renderer of all environments, or one for each world that looks differently."""
        from nodes.renderer.separate import SeparateRenderers

        if len(groups) == 1:
            return self._renderer(groups[0][0], self.params["envs"] * self.gathers)
        return SeparateRenderers(Parts(groups, self._each(groups)), self.params["envs"])

    def _each(self, groups: Sequence[Group]) -> list[Callable[[], Renderer | SupersampledRenderer]]:
        return [partial(self._renderer, scene, len(envs)) for scene, envs in groups]

    def _renderer(self, scene: Scene, envs: int) -> Renderer | SupersampledRenderer:
        """Makes the renderer of environments whose worlds look the same."""
        from nodes.renderer.renderer import Renderer
        from nodes.renderer.supersampling import SupersampledRenderer

        p, camera = self.params, camera_of(scene, self.params["camera"])
        how = {key: p[key] for key in ("margin", "device", "half")} | parameters.light_options(p)
        samples = p["supersampling"] or camera.supersampling
        how["threads"] = threads_for(p["threads"], envs * samples * camera.height * camera.width)
        if samples > 1:
            return SupersampledRenderer(scene, camera, samples, envs, **how, apart=p["samples_apart"])
        return Renderer(scene, camera, envs, **how)

    def update(self, inputs: Mapping[str, Message]) -> None:
        """Renders and publishes the wanted images of one state. Raises ValueError for one of another scene."""
        state = self._state(inputs)
        worlds = self.worlds.follow(state.own)
        if worlds is not self.worlds:
            before = self.worlds.drawn()
            self._follow(worlds)
            if worlds.drawn() != before:
                h = state.header
                self.publish("info", self._info(Header(h.stamp_ns, clock=h.clock, episode=h.episode)))
        poses = state.kept_end_pose()
        t = state.header.stamp_ns if state.own is None else np.array(state.own[:, STAMP])
        self._render([state], poses, self._before(poses, state), t)

    def update_all(self, inputs: Sequence[Mapping[str, Message]]) -> None:
        """Renders and publishes the images of several states at once, until an environment was reset by itself.

        Where fewer come than are rendered at once, the last one fills the rest.
        """
        from nodes.renderer.renderer import LAST

        if self.gathers == 1 or any(isinstance(s := one["state"], WorldState) and s.own is not None for one in inputs):
            self.take_singly()
            super().update_all(inputs)
            return
        states = [self._state(one) for one in inputs]
        for start in range(0, len(states), self.gathers):
            some = states[start : start + self.gathers]
            befores = []
            for state in some:
                pose = state.kept_end_pose()
                before = self._before(pose, state)
                befores.append(before if isinstance(before, np.ndarray) else self._earlier)
            rows = [*range(len(some)), *[len(some) - 1] * (self.gathers - len(some))]
            poses = np.concatenate([some[row].end_pose for row in rows])
            before = np.concatenate([befores[row] for row in rows]) if self.wants("motion") else LAST
            self._render(some, poses, before, np.array([some[row].header.stamp_ns for row in rows]))

    def take_singly(self) -> None:
        """Renders one state at a time from now on."""
        if self.gathers > 1:
            self.finish()
            super().take_singly()
            self._new = True
            self.renderer = self._renderers(self.worlds.groups(appearance))
            self.renderer.prepare(self._wanted())

    def _state(self, inputs: Mapping[str, Message]) -> WorldState:
        """Takes the state that comes; warns of what turns too fast in it, and once of what is not seen as it is.

        Raises ValueError for one of another scene.
        """
        state = inputs["state"]
        assert isinstance(state, WorldState)
        if state.names != self._names:
            raise ValueError(
                f"{self.name}: /state has bodies {', '.join(state.names)}, scene {self.scene.name} has "
                f"{', '.join(self._names)}; give both nodes the same scene and scene_args"
            )
        for line in self._turns.too_fast(state.moving, state.moving_twist):
            self.warn_alike(line)
        if self._first_look is not None:
            camera = camera_of(self.scene, self.params["camera"])
            for line in self._first_look.lines(camera, state.kept_end_pose()[0]):
                self.warn(f"scene {self.scene.name}: {line}")
            self._first_look = None
        return state

    def _render(
        self, states: Sequence[WorldState], poses: np.ndarray, before: np.ndarray | str, t: int | np.ndarray
    ) -> None:
        """Renders and publishes the images of states, the first of those whose poses float64 [n E, N, 7] these are."""
        wanted = self._wanted()
        on_gpu = self.renderer.device.is_cuda
        out: Any = self.renderer.buffers(wanted) if on_gpu else {f: self._loan(p, f) for f, p in wanted.items()}
        self.renderer.render(poses, before, out, out, t)
        envs = self.params["envs"]
        for field, port in wanted.items():
            images = self._loaned(port, field, out[field]) if on_gpu else out[field]
            if len(states) == 1:
                self.publish(port, self._message(port, field, states[0], images[:envs]))
                continue
            parts = parted(images, range(envs, (len(states) + 1) * envs, envs))
            self.publish_all(port, [self._message(port, field, *pair) for pair in zip(states, parts)])
        if "keyframe" in wanted.values():
            spare = 0 if self.gathers == 1 else len(poses) - len(states)
            self._told.append((self.renderer.counts_later(), spare, poses, t))
            # On a GPU this waits for the image: where nobody waits for the counts, until the next one is on its way.
            while len(self._told) > (self.gathers > 1 or (on_gpu and self.may_lag)):
                self._report()

    def finish(self) -> None:
        """Adds the counts of the last keyframe."""
        while self._told:
            self._report()

    def _wanted(self) -> dict[str, str]:
        """Names what is to be rendered now, with the port that it goes to."""
        wanted = {port: port for port in GEOMETRIC if self.wants(port)}
        if self.wants("keyframe"):
            grey = self.params["keyframes"] == "luminance"
            if self.params["keyframes"] == "auto":
                grey = not self.wants("keyframe", "radiance")
            wanted["luminance" if grey else "radiance"] = "keyframe"
        return wanted

    def _before(self, poses: np.ndarray, state: WorldState) -> np.ndarray | str:
        """Gives poses of the previous keyframe; this one's where an environment's episode begins.

        A state of the last one's stamp is of environments that begin there; the others are as they were.
        """
        from nodes.renderer.renderer import LAST

        stamp, episodes = state.header.stamp_ns, state.episodes
        previous = self._earlier if stamp == self._stamp else self._previous
        before: np.ndarray | str = LAST
        if previous is None or self._previous is None:
            before = previous = poses
        elif stamp == self._stamp or not np.array_equal(episodes, self._episodes):
            before = previous = np.where((episodes == self._episodes)[:, None, None], previous, poses)
        if self._new:
            before, self._new = previous, False
        self._earlier, self._previous, self._episodes, self._stamp = previous, poses, np.array(episodes), stamp
        return before

    def _loan(self, port: str, field: str) -> np.ndarray:
        return self.loan(port, **{field: self.renderer.array_shape(field)})[field]

    def _loaned(self, port: str, field: str, image: Any) -> Any:
        """Copies an image on its device: the renderer draws into the same buffers again, as graphs record where they
        write."""
        import warp as wp

        loan = self.loan_on(port, image.device, **{field: (image.shape, image.dtype)})[field]
        wp.copy(loan, image)
        return loan

    def _report(self) -> None:
        """Counts pixels of keyframes; the last `spare` of `poses` are those of one before them again."""
        counts_of, spare, poses, t = self._told.pop(0)
        counts = counts_of()
        if spare and any(counts):
            # How many each of these has, it alone tells.
            alone = [np.repeat(values[-1:], len(poses), axis=0) for values in (poses, t)]
            self.renderer.render(alone[0], None, self._wanted(), None, alone[1])
            each = [amount // len(poses) for amount in self.renderer.counts()]
            counts = [amount - spare * one for amount, one in zip(counts, each)]
        for name, amount in zip(("nonfinite_pixels", "clipped_pixels"), counts):
            if amount:
                self.count(name, amount)

    def _message(self, port: str, field: str, state: WorldState, image: np.ndarray) -> Message:
        header = Header(state.header.stamp_ns, clock=state.header.clock, episode=state.header.episode)
        margin = self.params["margin"]
        if port == "keyframe":
            message = Keyframe(header, np.array(state.episodes), margin=margin * self._fineness)
            message.own = None if state.own is None else np.array(state.own)
            setattr(message, field, image)
            return message
        return GEOMETRIC[port](header, **{field: image, "margin": margin})


def _between(params: Mapping[str, Any]) -> tuple[float, float]:
    """Gives the rate [Hz] at which single pixels are seen between frames, and that of keyframes; 0 where none are."""
    if not params["resolved"] or parameters.by_paths(params):
        return 0.0, 0.0
    return 1.0 / params["resolved"], params["keyframe_rate"]
