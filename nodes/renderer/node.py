"""Runs the renderer as a node: world states in, keyframe images of one camera out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from evis.gpu.in_a_row import parted
from evis.runtime.node import Node
from evis.scene.digest import appearance
from evis.scene.model import Scene
from evis.scene.parameters import camera_of, seeds_of, worlds_of
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
from nodes.renderer.declaration import RendererDeclaration
from nodes.renderer.poses_before import LAST, PosesBefore

if TYPE_CHECKING:
    from nodes.renderer.renderer import Renderer
    from nodes.renderer.separate import SeparateRenderers
    from nodes.renderer.supersampling import SupersampledRenderer

GEOMETRIC: dict[str, Any] = {"depth": Depth, "motion": Motion, "ids": Ids, "normal": Normal}
"""Outputs besides the keyframe, which are called as the array of their message is."""


class RendererNode(RendererDeclaration, Node):
    """Renders a keyframe for every world state, with the images that somebody reads."""

    renderer: Renderer | SupersampledRenderer | SeparateRenderers

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
            for line in undersampled(worlds.scenes, p["frame_rate"], *parameters.rates_between(p)):
                self.warn_alike(line)
        self._turns = Turns(self.scene, max(p["frame_rate"], parameters.rates_between(p)[0]))
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
        """Forgets all keyframes: the next one is the first of a run."""
        self._before = PosesBefore()
        self._told: list[tuple[Callable[[], Sequence[int]], int, np.ndarray, Any]] = []
        """Keyframes not counted yet: what tells their counts, how many poses at the end fill up, poses, times."""

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
        return self._before.state()

    def restore(self, state: tuple[Any, ...]) -> None:
        """Restores the poses that `state` gave."""
        self._before.restore(state)

    def _follow(self, worlds: Worlds) -> None:
        """Replaces the worlds, and the renderers of environments whose world looks otherwise then."""
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
        self._render([state], poses, self._before.take(poses, state), t)

    def update_all(self, inputs: Sequence[Mapping[str, Message]]) -> None:
        """Renders and publishes the images of several states at once, until an environment was reset by itself.

        Where fewer come than are rendered at once, the last one fills the rest.
        """
        if self.gathers == 1 or any(isinstance(s := one["state"], WorldState) and s.own is not None for one in inputs):
            self._render_singly()
            super().update_all(inputs)
            return
        states = [self._state(one) for one in inputs]
        for start in range(0, len(states), self.gathers):
            some = states[start : start + self.gathers]
            befores = []
            for state in some:
                before = self._before.take(state.kept_end_pose(), state)
                befores.append(before if isinstance(before, np.ndarray) else self._before.last)
            rows = [*range(len(some)), *[len(some) - 1] * (self.gathers - len(some))]
            poses = np.concatenate([some[row].end_pose for row in rows])
            before = np.concatenate([befores[row] for row in rows]) if self.wants("motion") else LAST
            self._render(some, poses, before, np.array([some[row].header.stamp_ns for row in rows]))

    def take_singly(self) -> None:
        """Renders one state at a time from now on, and counts what it has rendered before the next one."""
        self._render_singly()
        super().take_singly()
        self.finish()

    def _render_singly(self) -> None:
        """Makes the renderer for one state at a time, if it was for several."""
        if self.gathers > 1:
            self.finish()
            self.gathers = 1
            self._before.not_drawn()
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
