"""Makes frames at K times the keyframes' rate: the interpolator without bus and files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from evis.config.suggestions import nearest
from evis.gpu.building import LAUNCH_BLOCK, begin_building
from evis.gpu.devices import device_named
from evis.runtime.clock import subframe_stamps
from evis.scene.model import Camera, Scene
from nodes.interpolator import image_kernels
from nodes.interpolator import warm_up as made_up
from nodes.interpolator.keyframe import KeyframeView, Method, Report, States, check_follows, own_subframes
from nodes.interpolator.luminance import luminance_of, rgb_of, scalars
from nodes.interpolator.methods import METHODS, Gap
from nodes.interpolator.passthrough import crop
from nodes.interpolator.pixel_means import Allocate, PixelMeans, new_frames, new_frames_on
from nodes.interpolator.samples import Further
from nodes.renderer.raster.lens.cameras import finer

if TYPE_CHECKING:
    from nodes.renderer.paths.paths import PathOptions

Image = np.ndarray | wp.array
"""Of numpy, or on a device, where its vectors may be elements: [E, H, W] of vec3 in place of [E, H, W, 3]."""


class Interpolator:
    """Turns the stream of one camera's keyframes into frames.

    It remembers the last keyframe; the caller keeps that one's arrays valid.
    """

    def __init__(
        self,
        method: str,
        upsampling: int,
        *,
        colour: bool = False,
        device: str = "cpu",
        threads: int = 1,
        scene: Scene | None = None,
        camera: Camera | None = None,
        worlds: Sequence[Scene] = (),
        light_samples: int = 16,
        paths: PathOptions | None = None,
        tolerance: float | None = None,
        time_tolerance: float = 0.0,
        sampled: bool = True,
    ) -> None:
        """Makes the method for a camera's keyframes.

        method: a key of METHODS. upsampling: K. colour: frames are linear RGB instead of luminance.

        scene, camera, light_samples, paths: those of the renderer, for methods that use the bodies' states. Raises
        ValueError where these have none. worlds: the scene of each environment, where bodies move differently and all
        else looks as in `scene`. tolerance: error of log radiance that `rigid` looks for, to shade anew; 0.1 unless
        given, and with `time_tolerance` as refine.method.tolerance_of has it. time_tolerance: of the time at which what
        a pixel shows crosses a threshold [s], for which `rigid` takes `further` samples of single pixels; 0 = none.
        sampled: whether they are wanted; the frames are the same.
        """
        if method not in METHODS:
            raise ValueError(f"there is no interpolation method '{method}'; {nearest(method, METHODS)}")
        if upsampling < 1:
            raise ValueError(f"upsampling is {upsampling}; it must be 1 or more")
        if "state" in METHODS[method].reads and (scene is None or camera is None):
            raise ValueError(f"the {method} interpolator needs the scene and its camera; without them use splat")
        self._name = method
        self._scene, self._camera, self._worlds = scene, camera, worlds
        self._light: dict[str, Any] = {"light_samples": light_samples, "paths": paths, "tolerance": tolerance}
        self.upsampling = 1 if method == "none" else upsampling
        self._reads = METHODS[method].reads
        self._time_tolerance_ns, self._sampled = time_tolerance * 1e9, sampled
        self._colour = colour
        self._device = device_named(device)
        self._threads = threads
        self._method: Method | None = None
        self._size: tuple[tuple[int, ...], int] | None = None
        self._means = PixelMeans(camera, colour, self._device)
        self._warmed = False
        self._last: KeyframeView | None = None
        self._stamp = 0
        self._episodes = np.zeros(0, np.int32)
        self.report = Report()
        self.late = False
        """Whether `report` may be that of the gap before, so that nobody waits for a GPU; see `last_report`."""
        self.further: Further | None = None
        """Samples of single pixels between the frames made last, if there are any."""
        self.own_t: np.ndarray | None = None
        """Times int64 [E, K] ns of the frames made last, in own time, where environments have times of their own."""

    def push(
        self,
        stamp_ns: int,
        episodes: np.ndarray,
        image: Image,
        depth: Image | None,
        motion: Image | None,
        margin: int = 0,
        allocate: Allocate = new_frames,
        states: States | None = None,
        own: np.ndarray | None = None,
    ) -> tuple[np.ndarray, Any]:
        """Makes the frames of the gap that ends with this keyframe.

        image: radiance [E, H, W, 3] or, unless frames are in colour, luminance [E, H, W]; float32 or float16. depth:
        float32 [E, H, W] m. motion: float32 [E, H, W, 2] px; all of numpy or on the device, where they must stay as
        they are until the next call but one. margin: pixels beyond the image on every side. allocate: gives the array
        of a shape to write the frames into. states: of the bodies, from the keyframe before to this one. Of depth,
        motion and states only what the method uses is read. own: int64 [E] ns, the keyframe's time in each environment,
        where these have times of their own.

        A keyframe of the last one's stamp, with which some environments begin an episode, is for them alone.
        Returns (stamps int64 [K] ns, frames float32 [E, K, h, w] or, in colour, [E, K, h, w, 3]); K = 1 where all
        environments begin an episode. Environments that begin one while others go on hold this keyframe in all K
        frames. Where the camera is known and keyframes, margin included, are n times its size, they hold n x n samples
        of every pixel apart, which are averaged in the frames and in `further`. `report` tells what was filled. Raises
        ValueError.
        """
        self._fit(tuple(image.shape[:3]), margin)
        view = KeyframeView(
            self._image(image), self._use("depth", depth), self._use("motion", motion), stamp_ns=stamp_ns
        )
        view.states, view.own = self._check(states), own
        held = np.ones(image.shape[0], bool) if self._last is None else np.asarray(episodes) != self._episodes
        replaces = self._last is not None and stamp_ns == self._stamp and held.any() and not held.all()
        if replaces and self._last is not None:
            view.replaces, view.begun = self._last.replaces or self._last, held
            if self._last.begun is not None:
                view.begun = held | self._last.begun
        alone = replaces or held.all()
        stamps = np.array([stamp_ns]) if alone else self._stamps(view)
        out = allocate(self._means.shape(image.shape[0], len(stamps)))
        self.further, self.report = None, Report()
        if alone:
            self._show(view, margin, out)
        else:
            self._fill(view, held, out)
        self.own_t = None
        if own is not None:
            before = (self._last or view).times(len(held))
            self.own_t = own[:, None] if alone else own_subframes(before, own, held, len(stamps))
        self._last, self._stamp, self._episodes = view, stamp_ns, np.array(episodes)
        return stamps, out

    def last_report(self) -> Report:
        """Gives the report of the last gap, once, where `report` was that of the one before."""
        return getattr(self._method, "last_report", Report)()

    @property
    def last(self) -> tuple[int, np.ndarray]:
        """Gives the stamp [ns] and the episodes int32 [E] of the last keyframe, none before the first."""
        return self._stamp, self._episodes

    def shown(self, image: Image, margin: int, allocate: Allocate = new_frames) -> Any:
        """Gives the frames of a keyframe by itself, with arguments as of `push`, as if none had come."""
        out = allocate(self._means.shape(image.shape[0], 1))
        self._show(KeyframeView(self._image(image)), margin, out)
        return out

    def forget(self) -> None:
        """Forgets the last keyframe: the next one begins a run, at any time, in images of the same size."""
        self._last, self._stamp = None, 0
        self._episodes = np.zeros(0, np.int32)

    def _fit(self, shape: tuple[int, ...], margin: int) -> None:
        """Takes keyframes [E, H, W] of this size and margin from now on. Raises ValueError where others came before."""
        _, height, width = shape
        if min(height, width) <= 2 * margin:
            raise ValueError(f"keyframe of {width}x{height} px is no larger than its margin of {margin} px per side")
        if self._warmed and self._size != (shape, margin):
            self._size, self._method = None, None
        self._warmed = False
        if self._size not in (None, (shape, margin)):
            raise ValueError(f"keyframe is {shape} with margin {margin}, before it was {self._size}")
        if self._size is None:
            self._take_size(shape, margin)

    def _take_size(self, shape: tuple[int, ...], margin: int) -> None:
        """Works on keyframes [E, H, W] of this size from now on. Raises ValueError where it does not fit the camera."""
        _, height, width = shape
        self._means.fit(height, width, margin)
        self._size = shape, margin

    def _stamps(self, view: KeyframeView) -> np.ndarray:
        """Finds the times int64 [K] ns of the frames up to a keyframe. Raises ValueError where it comes too late."""
        check_follows(self._stamp, view.stamp_ns)
        return subframe_stamps(self._stamp, view.stamp_ns, self.upsampling)

    def _show(self, view: KeyframeView, margin: int, out: np.ndarray | wp.array) -> None:
        """Makes the one frame of a keyframe by itself."""
        made = self._means.target(out)
        crop(view, margin, made)
        self._means.average(made, out)

    def _fill(self, view: KeyframeView, held: np.ndarray, out: np.ndarray | wp.array) -> None:
        """Makes the frames of the gap from the last keyframe to this one, sets `report` and `further`."""
        assert self._last is not None
        method, made = self._made_method(), self._means.target(out)
        self.report = method.between(self._last, view, held, made)
        self.further = getattr(method, "further", None)
        self._means.average(made, out)

    def _made_method(self) -> Method:
        """Gives what makes the frames of gaps, built when it is first needed."""
        assert self._size is not None
        if self._method is None:
            (envs, height, width), margin = self._size
            self._method = self._build(envs, height, width, margin)
        return self._method

    def warm_up(self) -> None:
        """Compiles the kernels now rather than at the first keyframe, by a short gap of a size that may be another."""
        how: dict[str, Any] = {"colour": self._colour, "device": str(self._device)}
        height, width = 4, 4
        if "state" in self._reads and self._camera is not None:
            # These kernels depend on what there is in the scene.
            how |= {"scene": self._scene, "camera": self._camera, **self._light}
            height, width = self._camera.height, self._camera.width
        Interpolator(self._name, 2, **how).warm_up_for(1, height, width)

    def begin(self, envs: int, height: int, width: int, margin: int = 0) -> None:
        """Begins to build what gaps of this size need: kernels compile while the caller does something else.

        Arguments are those of `warm_up_for`, which ends it.
        """
        self._take_size((envs, height, width), margin)
        self._warmed_method()
        # Keyframes in colour go through it first.
        begin_building(self._device, [(image_kernels.luminance, LAUNCH_BLOCK)])

    def warm_up_for(self, envs: int, height: int, width: int, margin: int = 0, gap_ns: int = 0) -> None:
        """Builds, compiles and, on a GPU, records what gaps between such keyframes need, before the first real one.

        height, width: of the keyframes, margin included [px]. gap_ns: length of a gap, 0 = not known. The next
        keyframe begins an episode; should it be of another size, this was in vain.
        """
        self._warmed = True
        if self.upsampling > made_up.LONGEST:
            self.warm_up()
            self.begin(envs, height, width, margin)
            return
        self._image(np.ones((1, 2, 2, 3), np.float16))
        self.begin(envs, height, width, margin)
        prepare = getattr(self._warmed_method(), "prepare_for", lambda gap_ns: None)
        prepare(gap_ns)
        # Environments have had other episodes before their first.
        images, episodes = made_up.images(envs, height, width), np.full(envs, -1, np.int32)
        for stamp in made_up.stamps(1 if self._device.is_cpu else made_up.RECORDED):
            states = None
            if self._scene is not None and self._camera is not None:
                states = made_up.states(self._scene, self._camera, envs, stamp)
            self._push_made_up(stamp, episodes, images, states, margin)
        self._warmed = True
        self.last_report()
        prepare(0)

    def _warmed_method(self) -> Method:
        """Gives the method that a warm-up is for, built when it is first needed."""
        return self._made_method()

    def _push_made_up(
        self, stamp_ns: int, episodes: np.ndarray, images: made_up.Images, states: States | None, margin: int
    ) -> None:
        """Makes the gap that ends with a keyframe which was made up, as those of a run are made."""
        self.push(stamp_ns, episodes, *images, margin, self._scratch, states)

    def _scratch(self, shape: tuple[int, ...]) -> np.ndarray | wp.array:
        return new_frames_on(self._device, shape)

    def _build(self, envs: int, height: int, width: int, margin: int, in_a_row: bool = False) -> Method:
        camera = finer(self._camera, self._means.samples) if self._camera is not None else None
        gap = Gap(
            height, width, envs, self.upsampling, margin, 3 if self._colour else 1, str(self._device), self._threads,
            self._scene, camera, self._light, self._worlds,
            self._time_tolerance_ns, self._sampled, in_a_row, self.late, self._means.samples,
        )  # fmt: skip
        return METHODS[self._name].make(gap)

    def _check(self, states: States | None) -> States | None:
        """Gives the states that the method uses, or None. Raises ValueError where they fit neither scene nor gap."""
        if "state" not in self._reads or self._scene is None:
            return None
        if states is None:
            raise ValueError(f"the {self._name} interpolator needs the bodies' states with every keyframe")
        bodies = len(self._scene.bodies)
        given = states.end_pose.shape[1]
        if given != bodies:
            raise ValueError(f"the states have {given} bodies, scene {self._scene.name} has {bodies}")
        return states

    def _use(self, name: str, image: Image | None) -> wp.array | None:
        if name not in self._reads:
            return None
        if image is None:
            raise ValueError(f"the {self._name} interpolator needs {name} with every keyframe")
        return scalars(image, self._device)

    def _image(self, image: Image) -> wp.array:
        """Gives what is warped, luminance or RGB, in float32 on the device. Raises ValueError where there is no RGB."""
        if not self._colour:
            return luminance_of(image, self._device)
        if scalars(image, self._device).ndim != 4:
            raise ValueError("keyframes carry luminance, colour frames need their radiance (keyframes:=rgb)")
        rgb = rgb_of(image, self._device)
        return rgb.view(wp.float32).reshape((*rgb.shape, 3))
