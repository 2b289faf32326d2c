"""Measures samples between frames on scenes drawn at random, against dense rendering.

Things, materials, motions, lights and cameras are of all kinds.

python -m bench.interpolation.random_scenes [--quick]
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from tqdm import tqdm

from bench import command
from bench.interpolation.cases import FOCAL, HEIGHT, WIDTH, painted, plain, square
from bench.interpolation.pipeline import reference, simulate
from evis.events.measure.distance import victor_purpura
from evis.geometry import se3
from evis.runtime.clock import NS
from evis.scene.images import textures
from evis.scene.mesh import shapes, solids
from evis.scene.model import WORLD, Body, Camera, Instance, Light, Material, Mesh, Scene, Waveform
from evis.scene.motion import Linear, Motion, Prescribed, Sinusoid, Spin, Swing
from nodes.interpolator.auto.world import World

RATE, GAPS = 31.25, 3
TRUTH_HZ = 16_000.0
COUNT = 48
FEWEST = 500
"""Events of a scene below which it says little."""
WAYS = {
    "31x32 frames": ("rigid", RATE, 32, 0.0),
    "0.3 ms": ("rigid", RATE, 4, 3e-4),
    "0.1 ms": ("rigid", RATE, 8, 1e-4),
    "dense 1000 Hz": ("none", 32 * RATE, 1, 0.0),
}
"""Method, keyframes per second, K and time_tolerance [s]."""
STILL = se3.exp(np.zeros(3))
LENSES = (
    ("none", ()),
    ("none", ()),
    ("plumb_bob", (-0.2, 0.05, 0.001, -0.001, 0.0)),
    ("equidistant", (0.02, -0.01, 0, 0)),
)

Draw = np.random.Generator


def direction(draw: Draw) -> np.ndarray:
    """Draws a unit vector."""
    vector = draw.normal(size=3)
    return vector / np.linalg.norm(vector)


def picture(values: np.ndarray) -> Material:
    """Makes a material with a grey texture."""
    rgb = np.repeat(np.asarray(values, np.float32).reshape(*values.shape[:2], -1)[..., :1], 3, -1)
    return Material("picture", np.ones(3), rgb, two_sided=True)


def material(draw: Draw) -> Material:
    """Draws the material of a surface."""
    value, rough = draw.uniform(0.1, 0.9), float(draw.uniform(0.1, 0.6))
    kinds = (
        lambda: plain(value),
        painted,
        lambda: picture(textures.checker(512, 2 * int(draw.choice([4, 8, 32])), 0.1, 0.9)),
        lambda: picture(textures.noise(256, int(draw.integers(1000)), draw.uniform(0.01, 0.2), 0.1, 0.9)),
        lambda: plain(value, roughness=rough, metallic=1.0),
        lambda: plain(value, roughness=rough),
        lambda: plain(value, emission=np.full(3, draw.uniform(0.1, 3.0), np.float32)),
    )
    return kinds[draw.choice(len(kinds), p=(0.25, 0.2, 0.2, 0.15, 0.08, 0.07, 0.05))]()


def mesh(draw: Draw) -> Mesh:
    """Draws the mesh of a body."""
    size = draw.uniform(0.1, 0.6)
    kinds = (
        lambda: square(size, size * draw.uniform(0.3, 1.0)),
        lambda: square(0.01, 0.8),
        lambda: shapes.box(draw.uniform(0.1, 0.6, 3)),
        lambda: shapes.box(draw.uniform(0.1, 0.6, 3), 0.2),
        lambda: shapes.sphere(0.7 * size),
        lambda: shapes.cylinder(0.5 * size, 1.5 * size),
        lambda: shapes.disk(size),
        lambda: shapes.capsule(0.3 * size, size),
        lambda: solids.torus(0.8 * size, 0.2 * size),
        lambda: solids.rock(0.7 * size, 0.3, int(draw.integers(1000))),
    )
    return kinds[draw.integers(len(kinds))]()


def motions(draw: Draw) -> list[Motion]:
    """Draws how a body moves: not at all, along, to and fro, shaking; and turning, swinging or spinning fast."""
    along: tuple[Motion | None, ...] = (
        None,
        None,
        Linear(draw.normal(size=3) * draw.choice([0.5, 2.0, 6.0])),
        Sinusoid(0.3 * draw.normal(size=3), draw.uniform(0.5, 8.0), draw.uniform(0, 6)),
        Sinusoid(0.01 * draw.normal(size=3), draw.uniform(50.0, 300.0), draw.uniform(0, 6)),
    )
    about: tuple[Motion | None, ...] = (
        None,
        Spin(direction(draw), draw.uniform(2.0, 40.0)),
        Swing(direction(draw), draw.uniform(0.2, 1.5), draw.uniform(1.0, 10.0), draw.uniform(0, 6)),
        Spin(direction(draw), draw.uniform(60.0, 300.0)),
    )
    chosen = along[draw.integers(len(along))], about[draw.choice(len(about), p=(0.3, 0.3, 0.25, 0.15))]
    return [motion for motion in chosen if motion is not None]


def light(draw: Draw, body: int) -> Light:
    """Draws a lamp, which is fixed to a body."""
    place = np.array([draw.uniform(-1.5, 1.5), -draw.uniform(0.8, 2.0), draw.uniform(-0.5, 1.5)])
    aim = np.array([0.0, 0.0, 2.5]) - place
    aim /= np.linalg.norm(aim)
    strength, half, cone = draw.uniform(5.0, 40.0), draw.uniform(0.05, 0.3), draw.uniform(0.2, 0.6)
    waveform = None
    if draw.random() < 0.25:
        shape = str(draw.choice(["sine", "square"]))
        waveform = Waveform(
            shape, draw.uniform(50.0, 300.0), draw.uniform(0.2, 0.9), draw.random(), draw.uniform(0.2, 0.8)
        )
    given: dict[str, Any] = {"body": body, "shadows": bool(draw.random() < 0.85), "waveform": waveform}
    across = np.cross([0.0, 1.0, 0.0], aim)
    across /= np.linalg.norm(across)
    kinds = (
        lambda: Light("lamp", "point", np.full(3, strength), place, **given),
        lambda: Light("lamp", "spot", np.full(3, strength), place, direction=aim, cone=(0.8 * cone, cone), **given),
        lambda: Light("lamp", "directional", np.full(3, strength / 8), aim, **given),
        lambda: Light(
            "lamp", "area", np.full(3, strength / (4 * half**2)), place,
            half_u=half * across, half_v=half * np.cross(aim, across), **given,
        ),
    )  # fmt: skip
    return kinds[draw.choice(len(kinds), p=(0.35, 0.25, 0.25, 0.15))]()


def camera_motions(draw: Draw) -> list[Motion]:
    """Draws how the camera moves."""
    x, y, z = np.eye(3)
    kinds: tuple[list[Motion], ...] = (
        [],
        [Linear(0.5 * draw.normal(size=3))],
        [Swing(y, 0.3, draw.uniform(1.0, 4.0))],
        [Swing(x, 0.02, draw.uniform(10.0, 40.0)), Sinusoid(0.01 * draw.normal(size=3), draw.uniform(10.0, 40.0))],
        [Swing(z, 0.5, draw.uniform(5.0, 10.0))],
    )
    return kinds[draw.choice(len(kinds), p=(0.35, 0.2, 0.2, 0.15, 0.1))]


def random_scene(seed: int) -> Scene:
    """Draws a wall, up to six things before it, up to three lamps, a sky and a camera."""
    draw = np.random.default_rng(seed)
    wall = Prescribed(se3.make_pose(np.array([0, 0, 3.5]), se3.exp(np.array([0, draw.uniform(-0.5, 0.5), 0]))))
    things = [(square(4.0), material(draw), wall)]
    for _ in range(draw.integers(1, 7)):
        depth, moves = draw.uniform(1.0, 3.0), motions(draw)
        place = depth * np.array([draw.uniform(-0.5, 0.5), draw.uniform(-0.4, 0.4), 1.0])
        # What flies is in the image in the middle of the time.
        place -= 0.05 * sum((m.velocity for m in moves if isinstance(m, Linear)), np.zeros(3))
        parent = things[-1][2] if len(things) > 1 and draw.random() < 0.2 else None
        if parent is not None:
            place = 0.4 * draw.normal(size=3)
        path = Prescribed(se3.make_pose(place, se3.exp(draw.normal(size=3))), moves, parent)
        things.append((mesh(draw), material(draw), path))
    bodies = [Body(f"thing{n}", path) for n, (_, _, path) in enumerate(things)]
    lights = []
    for n in range(draw.integers(0, 4)):
        on = WORLD
        if draw.random() < 0.25:
            on = len(bodies)
            sway = Sinusoid(0.3 * draw.normal(size=3), draw.uniform(1.0, 8.0))
            bodies.append(Body(f"stand{n}", Prescribed(se3.make_pose(np.zeros(3), STILL), [sway])))
        lights.append(replace(light(draw, on), name=f"lamp{n}"))
    bodies.append(Body("cam0", Prescribed(se3.make_pose(np.zeros(3), STILL), camera_motions(draw))))
    focal, (model, coefficients) = FOCAL * draw.uniform(0.7, 1.3), LENSES[draw.integers(len(LENSES))]
    k = np.array([[focal, 0, (WIDTH - 1) / 2 + 0.3], [0, focal, (HEIGHT - 1) / 2 - 0.2], [0, 0, 1]])
    lens = Camera("cam0", WIDTH, HEIGHT, k, distortion_model=model, distortion=coefficients)
    sky = np.full(3, draw.uniform(0.02, 0.5))
    mapped = None
    if draw.random() < 0.15:
        mapped = np.repeat(textures.noise(128, seed, 0.1, 0.05, 2.0)[:64, :, None].astype(np.float32), 3, -1)
    instances = [Instance(f"thing{n}", n, shape, n) for n, (shape, _, _) in enumerate(things)]
    materials = [replace(made, name=f"material{n}") for n, (_, made, _) in enumerate(things)]
    return Scene(f"random{seed}", bodies, instances, materials, lights, [lens], sky, environment_map=mapped)


def measured(count: int, truth_hz: float) -> list[dict[str, Any]]:
    """Measures all ways on the first `count` scenes: events of each, and by way error, events too many and time [s]."""
    duration, found = round(GAPS * NS / RATE), []
    for seed in tqdm(range(count), disable=None):
        world = World(random_scene(seed), duration)
        truth = reference(world, truth_hz, duration, NS)[0]
        if len(truth.t) < FEWEST:
            continue
        scene: dict[str, Any] = {"seed": seed, "events": len(truth.t)}
        for way, (method, rate, upsampling, tolerance) in WAYS.items():
            warp = {"time_tolerance": tolerance} if tolerance else {}
            run = simulate(world, method, rate, upsampling, duration, warp=warp)
            events = run.streams["linear"]
            change = len(events.t) / len(truth.t) - 1
            scene[way] = victor_purpura(events, truth, 1.0), change, run.seconds("linear") / GAPS
        found.append(scene)
    return found


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures all ways on 48 scenes; quick: on four, against 4 kHz."""
    truth_hz = TRUTH_HZ / 4 if quick else TRUTH_HZ
    scenes = measured(4 if quick else COUNT, truth_hz)
    rows = []
    for way in WAYS:
        error, change, spent = np.array([scene[way] for scene in scenes]).T
        slower = spent / np.array([scene["31x32 frames"][2] for scene in scenes])
        rows.append(
            {
                "way": way,
                "error: median": f"{np.median(error):.3f}",
                "nine of ten": f"{np.quantile(error, 0.9):.3f}",
                "worst": f"{error.max():.3f}",
                "events [%]: median": f"{100 * np.median(change):+.1f}",
                "least": f"{100 * change.min():+.1f}",
                "most": f"{100 * change.max():+.1f}",
                "time of 31x32's: median": f"{np.median(slower):.2f}",
            }
        )
    return {
        "random_scenes": {
            "title": f"{len(scenes)} scenes drawn at random, {WIDTH} px wide: error, events too many, CPU time",
            "command": "python -m bench.interpolation.random_scenes",
            "rows": rows,
            "note": f"Victor-Purpura at 1/ms against dense rendering at {truth_hz:g} Hz, {GAPS} gaps of "
            f"{1e3 / RATE:g} ms; scenes of {FEWEST} events or more.",
        }
    }


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
