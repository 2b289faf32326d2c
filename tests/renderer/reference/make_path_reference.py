"""Radiance of small scenes by Mitsuba 3 with light over several surfaces, hidden sky light and glowing surfaces.

`pip install mitsuba==3.9.1 numpy` in an environment of its own, then `python make_path_reference.py` writes
path_reference.npz: for each scene, the mean [16, 24, 3] and its standard error. The scenes are those of
tests/renderer/paths/test_path_reference.py; camera and conventions are those of make_reference.py beside this file.
"""

import sys
from pathlib import Path

import mitsuba as mi
import numpy as np
from make_reference import HEIGHT, WIDTH, diffuse, directions, metal, rectangle, sky

SAMPLES = 2048


def walls():
    grey, red, green = diffuse(0.7, 0.7, 0.7), diffuse(0.6, 0.1, 0.1), diffuse(0.1, 0.5, 0.15)
    return {
        "floor": rectangle((0, 1, 2.5), (1.2, 0, 0), (0, 0, 1.5), bsdf=grey),
        "ceiling": rectangle((0, -1, 2.5), (1.2, 0, 0), (0, 0, 1.5), bsdf=grey),
        "back": rectangle((0, 0, 4), (1.2, 0, 0), (0, 1, 0), bsdf=grey),
        "left": rectangle((-1.2, 0, 2.5), (0, 1, 0), (0, 0, 1.5), bsdf=red),
        "right": rectangle((1.2, 0, 2.5), (0, 1, 0), (0, 0, 1.5), bsdf=green),
    }


def block(**more):
    turn = mi.ScalarTransform4f().translate([0.35, 0.7, 2.9]).rotate([0, 1, 0], 30).scale(0.3)
    return {"type": "cube", "to_world": turn, **more}


def scenes():
    """Description and Mitsuba's max_depth, which is our number of bounces and 2."""
    black = diffuse(0.0, 0.0, 0.0)
    shine = {"type": "area", "radiance": {"type": "rgb", "value": [12.0, 10.0, 7.0]}}
    light = {"lamp": rectangle((0, -0.98, 2.6), (0.4, 0, 0), (0, 0, -0.3), bsdf=black, emitter=shine)}
    plain = {"block": block(bsdf=diffuse(0.8, 0.6, 0.3))}
    glow = {"type": "area", "radiance": {"type": "rgb", "value": [6.0, 5.0, 4.0]}}
    open_ = {name: wall for name, wall in walls().items() if name in ("floor", "left")}
    ball = {"ball": {"type": "sphere", "center": [0.3, 0.5, 2.8], "radius": 0.5, "bsdf": metal(0.3)}}
    return {
        "box": ({**walls(), **plain, **light}, 5),
        "glow": ({**walls(), "block": block(bsdf=black, emitter=glow)}, 4),
        "sky": ({**open_, **plain, "sky": sky()}, 2),
        "sky_bounced": ({**open_, **plain, "sky": sky()}, 4),
        "metal": ({**walls(), **ball, **light}, 4),
    }


def measure(description, depth: int, samples: int) -> tuple[np.ndarray, np.ndarray]:
    scene = mi.load_dict({"type": "scene", **description})
    integrator = mi.load_dict({"type": "path", "max_depth": depth, "rr_depth": 1000})
    sampler = mi.load_dict({"type": "independent"})
    values = np.empty((HEIGHT, WIDTH, samples, 3))
    for index in np.ndindex(HEIGHT, WIDTH):
        ray = mi.RayDifferential3f(mi.Ray3f([0, 0, 0], directions()[index].tolist()))
        sampler.seed(index[0] * WIDTH + index[1])
        for k in range(samples):
            values[index][k] = np.array(integrator.sample(scene, sampler, ray)[0])
    return values.mean(2), values.std(2) / samples**0.5


def main() -> None:
    out = {}
    for name, (description, depth) in scenes().items():
        out[name], out[f"{name}_error"] = (a.astype(np.float32) for a in measure(description, depth, SAMPLES))
        print(name, out[name].mean((0, 1)), out[f"{name}_error"].mean(), file=sys.stderr)
    np.savez_compressed(Path(__file__).parent / "path_reference.npz", **out)


if __name__ == "__main__":
    main()
