"""Measures the CPU time of the warp and of the event sensor per pixel and sub-frame, and what each omission saves.

    evis bench interpolation_speed [--quick]

One compute thread, 346x260, 30x8 unless said: 21.6 million pixels per simulated second, so 10 ns per pixel and
sub-frame are 0.22 s of CPU time per simulated second. CPU time of the process, the least of several runs.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from bench import command
from evis.media.colour import luminance_of
from nodes.event_sensor.sensor import EventSensor
from nodes.interpolator.keyframe import KeyframeView
from nodes.interpolator.splat.splat import make_splat

HEIGHT, WIDTH, RATE, UPSAMPLING = 260, 346, 30, 8
GAP = round(1e9 / RATE)
COMMAND = "evis bench interpolation_speed"


def cpu_s(work: Callable[[], Any], repeats: int) -> float:
    """Measures the least CPU time of one call [s], after one that is not counted."""
    work()
    times = []
    for _ in range(repeats):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def per_sample(seconds: float, frames: int) -> float:
    """Converts CPU seconds to ns per pixel and sub-frame."""
    return round(seconds / (frames * HEIGHT * WIDTH) * 1e9, 2)


class Disk:
    """Makes keyframes of a textured disk that spins in the image plane; its share of the image is given."""

    def __init__(self, share: float, omega: float = 50.0, channels: int = 1, creep: float = 0.0) -> None:
        """creep: motion [px] given to the wall, below the warp's grid: it stays where it is but counts as moving."""
        y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
        self._x, self._y = x - WIDTH / 2, y - HEIGHT / 2
        radius = np.sqrt(share * HEIGHT * WIDTH / np.pi) if share < 1 else HEIGHT + WIDTH
        self._inside = np.hypot(self._x, self._y) < radius
        self._turn = omega / RATE
        self._channels = channels
        self._creep = creep

    def image(self, k: float) -> np.ndarray:
        """Draws float32 [H, W] luminance at keyframe time k."""
        c, s = np.cos(self._turn * k), np.sin(self._turn * k)
        u, v = c * self._x + s * self._y, c * self._y - s * self._x
        pattern = np.exp(0.8 * np.tanh(3 * np.sin(0.2 * u) * np.sin(0.2 * v)))
        return np.where(self._inside, pattern, 0.3).astype(np.float32)

    def view(self, k: float) -> KeyframeView:
        """Makes keyframe k."""
        c, s = np.cos(self._turn), np.sin(self._turn)
        back = np.stack([c * self._x + s * self._y - self._x, c * self._y - s * self._x - self._y], -1)
        motion = np.where(self._inside[..., None], back, self._creep)
        image = self.image(k)
        if self._channels == 3:
            image = np.repeat(image[..., None], 3, -1)
        return KeyframeView(on_cpu(image), on_cpu(np.where(self._inside, 1.0, 2.0)), on_cpu(motion))


def on_cpu(image: np.ndarray) -> wp.array:
    """Puts an image into a Warp array [1, ...] float32 on the CPU."""
    return wp.array(np.ascontiguousarray(image[None], dtype=np.float32), device="cpu")


def time_splat(a: KeyframeView, b: KeyframeView, repeats: int, upsampling: int = UPSAMPLING) -> float:
    """Measures ns per pixel and sub-frame of one gap."""
    channels = 3 if a.image.ndim == 4 else 1
    method = make_splat(HEIGHT, WIDTH, 1, upsampling, 0, channels)
    out = np.empty((1, upsampling, HEIGHT, WIDTH) + ((3,) if channels == 3 else ()), np.float32)
    return per_sample(cpu_s(lambda: method.between(a, b, [False], out), repeats), upsampling)


def drop_one(view: KeyframeView) -> KeyframeView:
    """Takes one source away from a keyframe, which leaves one hole."""
    assert view.motion is not None
    motion = view.motion.numpy().copy()
    motion[0, HEIGHT // 2, WIDTH // 2] = np.nan
    return KeyframeView(view.image, view.depth, on_cpu(motion[0]))


def splat_rows(repeats: int) -> list[dict[str, Any]]:
    """Measures the warp on disks that fill ever more of the image."""
    rows = []
    for share in (0.0, 0.05, 0.3, 0.6, 1.0):
        disk = Disk(share)
        rows.append({"moving part": f"{share:.0%}", "ns": time_splat(disk.view(0), disk.view(1), repeats)})
    return rows


def omission_rows(repeats: int) -> list[dict[str, Any]]:
    """Measures each omission: the cost with it, and of the same frames when it cannot be made."""

    def row(what: str, with_it: float, without: float) -> dict[str, Any]:
        return {"left out": what, "ns": with_it, "ns without": without, "saved": f"{1 - with_it / without:.0%}"}

    disk, creeping = Disk(0.3), Disk(0.3, creep=1e-6)
    as_is = time_splat(disk.view(0), disk.view(1), repeats)
    rows = [row("pixels that do not move", as_is, time_splat(creeping.view(0), creeping.view(1), repeats))]
    still = Disk(0.3, omega=0.0, creep=1e-6)
    whole = time_splat(still.view(0), still.view(0), repeats)
    rows.append(row("A, where B left no hole", whole, time_splat(still.view(0), drop_one(still.view(0)), repeats)))
    colour = Disk(0.3, channels=3)
    rows.append(row("two of three channels (luminance)", as_is, time_splat(colour.view(0), colour.view(1), repeats)))
    return rows


def time_sensor(frames: np.ndarray, repeats: int, size: int = UPSAMPLING) -> tuple[float, int]:
    """Measures (ns per pixel and sub-frame, events) of a video [T, H, W] in messages of `size` frames."""
    episodes = np.zeros(1, np.int32)
    stamps = (np.arange(len(frames), dtype=np.int64) * GAP) // UPSAMPLING
    times, events = [], 0
    for _ in range(repeats):
        sensor = EventSensor(HEIGHT, WIDTH)
        sensor.process(frames[None, :1], stamps[:1], episodes)
        start, events = time.process_time(), 0
        for first in range(1, len(frames), size):
            part = slice(first, first + size)
            events += len(sensor.process(frames[None, part], stamps[part], episodes).t)
        times.append(time.process_time() - start)
    return per_sample(min(times), len(frames) - 1), events


def sensor_rows(repeats: int, gaps: int) -> list[dict[str, Any]]:
    """Measures the sensor on the same disk, sampled exactly at each sub-frame."""
    rows = []
    for share in (0.0, 0.05, 0.3, 1.0):
        disk = Disk(share, omega=10.0)
        video = np.stack([disk.image(i / UPSAMPLING) for i in range(gaps * UPSAMPLING + 1)])
        ns, events = time_sensor(video, repeats)
        rate = events / (gaps / RATE) / 1e6
        rows.append({"moving part": f"{share:.0%}", "ns": ns, "million events/s": round(rate, 2)})
        if share == 0.3:
            ns, _ = time_sensor(video, repeats, 1)
            rows.append({"moving part": "30%, one frame per message", "ns": ns, "million events/s": round(rate, 2)})
    return rows


def scene_rows(repeats: int, gaps: int) -> list[dict[str, Any]]:
    """Measures warp and sensor on the rendered spinning disk."""
    from evis.scene import load_scene
    from nodes.physics.engines.prescribed import prescribed_states
    from nodes.renderer.renderer import Renderer

    scene = load_scene("spinning_disk", {"width": WIDTH, "height": HEIGHT})
    renderer = Renderer(scene, scene.cameras[0])
    views, before = [], None
    for k in range(gaps + 1):
        pose = prescribed_states(scene, np.array([k * GAP]))[0][None, 0]
        images = renderer.render(pose, pose if before is None else before, ("radiance", "depth", "motion"))
        luminance = luminance_of(images["radiance"])
        views.append(KeyframeView(on_cpu(luminance[0]), on_cpu(images["depth"][0]), on_cpu(images["motion"][0])))
        before = pose
    method = make_splat(HEIGHT, WIDTH, 1, UPSAMPLING)
    out = np.empty((gaps, 1, UPSAMPLING, HEIGHT, WIDTH), np.float32)

    def warp_all() -> None:
        for k in range(gaps):
            method.between(views[k], views[k + 1], [False], out[k])

    splat = per_sample(cpu_s(warp_all, repeats), gaps * UPSAMPLING)
    video = np.concatenate([views[0].image.numpy(), out.reshape(-1, HEIGHT, WIDTH)])
    sensor, events = time_sensor(video, repeats)
    total = (splat + sensor) * 1e-9 * RATE * UPSAMPLING * HEIGHT * WIDTH
    return [
        {
            "scene": "spinning_disk 50 rad/s",
            "splat ns": splat,
            "sensor ns": sensor,
            "million events/s": round(events / (gaps / RATE) / 1e6, 2),
            "CPU s per simulated s": round(total, 3),
        }
    ]


def flicker_rows(gaps: int) -> list[dict[str, Any]]:
    """Measures `rigid` under a lamp that flickers: by its waveform, and with every surface shaded at every sub-frame.

    For the latter it gets a second lamp without light and with another waveform. Least CPU time of several gaps."""
    from evis.scene import load_scene
    from evis.scene.model import Scene, Waveform
    from nodes.interpolator.keyframe import States
    from nodes.interpolator.rigid import Rigid
    from nodes.physics.engines.prescribed import prescribed_states
    from nodes.renderer.renderer import Renderer

    def flickering(scene: Scene) -> tuple[Scene, Scene]:
        lamp = replace(scene.lights[0], waveform=Waveform("sine", 100.0, 0.8))
        dark = replace(lamp, colour=np.zeros(3), waveform=Waveform("sine", 120.0, 0.8))
        lights = [lamp, *scene.lights[1:]]
        return replace(scene, lights=lights), replace(scene, lights=[*lights, dark])

    rows = []
    for name in ("spinning_disk", "drone"):
        pair = flickering(load_scene(name, {"width": WIDTH, "height": HEIGHT}))
        renderer = Renderer(pair[0], pair[0].cameras[0])
        methods = [Rigid(scene, scene.cameras[0], 1, UPSAMPLING) for scene in pair]
        out = np.empty((1, UPSAMPLING, HEIGHT, WIDTH), np.float32)
        last: KeyframeView | None = None
        times: list[list[float]] = [[], []]
        shares = [0.0, 0.0]
        for k in range(1, gaps + 3):
            t = np.array([(k - 1) * GAP, k * GAP])
            pose, twist = (a[None] for a in prescribed_states(pair[0], t))
            image = renderer.render(pose[:, -1], None, ("radiance",), t_ns=k * GAP)["radiance"]
            view = KeyframeView(on_cpu(luminance_of(image[0])), states=States(t, pose, twist), stamp_ns=k * GAP)
            for n, method in enumerate(methods if last is not None else []):
                assert last is not None
                start = time.process_time()
                report = method.between(last, view, [False], out)
                times[n].append(time.process_time() - start)
                shares[n] = report.reshaded / report.samples
            last = view
        for n, label in enumerate(("by its waveform", "shaded at every sub-frame")):
            ns = per_sample(min(times[n][1:]), UPSAMPLING)
            rows.append({"scene": name, "flickering light": label, "ns": ns, "shaded anew": f"{shares[n]:.1%}"})
    return rows


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures all tables."""
    repeats, gaps = (3, 4) if quick else (9, 12)
    note = "ns = CPU nanoseconds per pixel and sub-frame, 346x260, K = 8, one thread"
    return {
        "scene": {
            "title": "Warp and sensor on a rendered scene",
            "command": COMMAND,
            "rows": scene_rows(repeats, gaps),
            "note": f"{note}; 30 Hz x 8, threshold 0.2",
        },
        "splat": {"title": "Warp by moving part", "command": COMMAND, "rows": splat_rows(repeats), "note": note},
        "omissions": {
            "title": "What the warp leaves out",
            "command": COMMAND,
            "rows": omission_rows(repeats),
            "note": f"{note}; the same frames, made so that the omission is impossible; disk on 30 % of the image",
        },
        "flicker": {
            "title": "A lamp at 100 Hz under rigid",
            "command": COMMAND,
            "rows": flicker_rows(gaps),
            "note": note,
        },
        "sensor": {
            "title": "Event sensor by moving part",
            "command": COMMAND,
            "rows": sensor_rows(repeats, gaps),
            "note": f"{note}; sorting and unpacking of events included",
        },
    }


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
