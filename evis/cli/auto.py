"""`interpolator:=auto`: method, keyframe rate and K in its place, by measuring the scene before the graph starts.

What was measured is kept on disk, by what it depends on: the scene's content, the arguments, the machine, and the code
itself. The choice is made of arguments, so that the plan, the bag and the result hold it like any other.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from evis.console.printable import printable

if TYPE_CHECKING:
    from evis.launch.expand import NodeSpec
    from evis.launch.files import LaunchFile
    from evis.launch.planner import Options
    from nodes.interpolator.auto.setting import Setting
    from nodes.interpolator.auto.trial import Measured

SENSOR = ("threshold", "threshold_on", "threshold_off", "crossing", "dark_level")
"""The sensor's parameters that count; noise is no matter of how frames are made."""
WARP = ("tolerance", "sample_px")
"""The interpolator's parameters that count."""
CODE = {
    "nodes": ("renderer/**/*.py", "interpolator/**/*.py", "event_sensor/**/*.py", "physics/**/*.py"),
    "evis": ("geometry/**/*.py", "scene/**/*.py", "events/measure/distance*.py"),
}
"""Files whose content decides cost and error, by package."""
LONGEST_S = 2.0
"""How much of a run's beginning is looked at [s]; of one without an end, 1 s."""


def resolve_auto(
    launch: LaunchFile, given: Mapping[str, Any], options: Options
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The arguments with auto replaced, and what was chosen: {} where nothing is to be chosen.

    Raises ValueError where the scene cannot be measured or a wish makes no sense.
    """
    from evis.launch.arguments import ArgumentError, resolve
    from evis.launch.expand import expand

    if "interpolator" not in launch.arguments or "wanted_error" not in launch.arguments:
        return dict(given), {}
    values = resolve(launch.path.name, launch.arguments, given)
    if values["interpolator"] != "auto":
        for name in ("wanted_error", "wanted_rtf"):
            if values[name] is not None:
                raise ArgumentError(f"{name} is for interpolator:=auto, which chooses by it")
        return dict(given), {}
    from nodes.interpolator.auto.trial import settle

    # Any method with frames in between stands for the choice, so that all nodes are there with their parameters.
    stand_in = {**given, "interpolator": "rigid", "upsampling": 2}
    graph = expand(launch, stand_in, options.names())
    wishes = {key: values[key] if key in given else None for key in ("keyframe_rate", "upsampling")}
    own_rates = bool(graph.values.get("camera_rate"))
    if own_rates:
        # The rates of the others are fractions of it; what is measured is the first camera at its own.
        wishes["keyframe_rate"] = next(n.params["keyframe_rate"] for n in graph.nodes if n.type == "renderer")
    setting = setting_of(graph.nodes, options.duration_s, wishes)
    found, cached = measured(setting)
    tried = len(found.trials)
    with told() as say:
        choice = settle(setting, found, values["wanted_error"], values["wanted_rtf"], say)
    if not cached or len(found.trials) > tried:
        keep(setting, found)
    best = choice.candidate
    taken = {
        "interpolator": best.method,
        "keyframe_rate": values["keyframe_rate"] if own_rates else best.keyframe_rate,
        "upsampling": best.upsampling,
    }
    expectation = {
        "expected_error": best.error,
        "expected_s_per_simulated_s": best.seconds,
        "candidates": len(found.candidates),
        "trials": len(found.trials),
    }
    expected = f"error {best.error:.3g} of 1, {best.seconds:.3g} s per simulated second"
    chosen: dict[str, Any] = taken | {"why": choice.why}
    if values["wanted_error"] is not None or values["wanted_rtf"] is not None:
        chosen["wish_kept"] = choice.met
    chosen |= expectation | {"from_cache": cached, "summary": f"{best}: {choice.why}; expected: {expected}"}
    return {**given, **taken}, chosen


def setting_of(nodes: Sequence[NodeSpec], duration_s: float | None, wishes: Mapping[str, Any]) -> Setting:
    """What is measured: the first renderer of the graph and what follows it. wishes: the user's keyframe_rate and
    upsampling, or None."""
    from evis.scene.load import load_scene, parse_args
    from nodes.event_sensor.parameters import resolve_sensor
    from nodes.interpolator.auto.setting import Setting

    by_type = {node.type: node.params for node in reversed(nodes)}
    if not {"renderer", "event_sensor"} <= by_type.keys():
        raise ValueError("interpolator auto needs a graph with a renderer and an event sensor to measure")
    p = by_type["renderer"]
    size = {key: int(p[key]) for key in ("width", "height") if p.get(key)}
    scene = load_scene(p["scene"], {**parse_args(p.get("scene_args") or ""), **size})
    try:
        camera = scene.camera(p.get("camera") or "cam0")
    except KeyError as error:
        raise ValueError(error.args[0]) from None
    given = {k: v for k, v in by_type["event_sensor"].items() if k in SENSOR and v is not None}
    full = resolve_sensor("event sensor", by_type["event_sensor"].get("preset") or "ideal", given)
    sensor = {key: full[key] for key in SENSOR if full[key] is not None}
    # Its curve needs the light's slope, which frames of a warp do not have.
    sensor["crossing"] = "monotone" if sensor["crossing"] == "hermite" else sensor["crossing"]
    frames = by_type.get("interpolator", {})
    if p.get("supersampling"):
        camera = replace(camera, supersampling=int(p["supersampling"]))
    light: dict[str, Any] = {"light_samples": p["light_samples"]} if p.get("light_samples") else {}
    if p.get("bounces") or p.get("sky_occlusion"):
        from nodes.renderer.paths.paths import PathOptions

        light["paths"] = PathOptions(p["bounces"], p["path_samples"], bool(p.get("roulette")))
    return Setting(
        scene,
        camera,
        round(min(duration_s or 1.0, LONGEST_S) * 1e9),
        seed=by_type.get("physics", {}).get("seed") or 0,
        sensor=sensor,
        light=light,
        warp={key: frames[key] for key in WARP if frames.get(key) is not None},
        **{key: p[key] for key in ("device", "envs", "threads", "margin")},
        **wishes,
    )


def measured(setting: Setting) -> tuple[Measured, bool]:
    """What every candidate costs and how far off it is, and whether that was known."""
    from evis.gpu.devices import device_named
    from nodes.interpolator.auto.probe import probe
    from nodes.interpolator.auto.trial import Measured

    device_named(setting.device)
    try:
        return Measured.of_json(json.loads(path_of(setting).read_text())), True
    except (OSError, ValueError, TypeError, KeyError):
        pass
    with told() as say:
        return probe(setting, say), False


def keep(setting: Setting, found: Measured) -> None:
    """Write down what was measured, for the next time."""
    path = path_of(setting)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(f".{os.getpid()}")
        part.write_text(json.dumps(found.as_json(), indent=1))
        part.replace(path)
    except OSError as error:
        print(f"interpolator auto: what was measured is not kept: {printable(error)}", file=sys.stderr)


@contextmanager
def told() -> Iterator[Callable[[str], None]]:
    """Shows on a terminal what is being measured, and for how long, in a line that is gone afterwards."""
    shown, began = sys.stderr.isatty(), time.monotonic()

    def say(line: str) -> None:
        if shown:
            spent = f"{time.monotonic() - began:.0f} s"
            print(
                f"\r\033[Kinterpolator auto, measuring, {spent}: {printable(line)}", end="", file=sys.stderr, flush=True
            )

    try:
        yield say
    finally:
        if shown:
            print("\r\033[K", end="", file=sys.stderr, flush=True)


def path_of(setting: Setting) -> Path:
    """File of what was measured of a setting."""
    return cache_folder() / f"{fingerprint(setting)}.json"


def cache_folder() -> Path:
    """Where what was measured is kept."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "evis" / "auto"


def fingerprint(setting: Setting) -> str:
    """Of all that cost and error depend on."""
    import evis

    found = hashlib.sha256(code_digest())
    _digest(found, setting)
    import warp

    machine = [platform.node(), platform.machine(), os.cpu_count(), platform.python_version(), warp.config.version]
    if setting.device.startswith("cuda"):
        warp.init()
        machine.append(warp.get_device(setting.device).name)
    found.update(repr([machine, getattr(evis, "__version__", ""), np.__version__]).encode())
    return found.hexdigest()[:32]


@functools.cache
def code_digest() -> bytes:
    """Of the code that is measured and of what measures it, as it was when first asked for."""
    from evis.neighbours import ROOT

    found = hashlib.sha256()
    for package, patterns in CODE.items():
        root = ROOT / package
        for path in sorted(path for pattern in patterns for path in root.glob(pattern)):
            found.update(path.relative_to(root).as_posix().encode())
            found.update(path.read_bytes())
    return found.digest()


def _digest(found: Any, value: Any) -> None:
    """Add a value to a hash: what it holds, whatever it is made of."""
    found.update(type(value).__name__.encode())
    if isinstance(value, np.ndarray):
        found.update(repr((value.shape, value.dtype.str)).encode())
        found.update(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, Path):
        found.update(value.read_bytes() if value.is_file() else str(value).encode())
    elif isinstance(value, Mapping):
        for key in value:
            _digest(found, key)
            _digest(found, value[key])
    elif isinstance(value, (list, tuple)):
        for item in value:
            _digest(found, item)
    elif callable(value):
        found.update(value.__qualname__.encode() if hasattr(value, "__qualname__") else b"")
    elif hasattr(value, "__dict__"):
        _digest(found, vars(value))
    else:
        found.update(repr(value).encode())
