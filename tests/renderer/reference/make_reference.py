"""Radiance of small scenes by Mitsuba 3, along the rays through pixel centres; direct light only.

`pip install mitsuba==3.9.1 numpy` in an environment of its own, then `python make_reference.py` writes reference.npz:
for each scene, the mean [16, 24, 3] and its standard error. Everything is in the camera's frame: x right, y down,
z forward. The scenes are those of tests/renderer/shading/test_light_reference.py.
"""

import sys
from pathlib import Path

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")
SAMPLES = 2048
WIDTH, HEIGHT, FOCAL = 24, 16, 20.0


def directions() -> np.ndarray:
    """Unit vectors [H, W, 3] through the pixel centres."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    d = np.stack([(x - (WIDTH - 1) / 2) / FOCAL, (y - (HEIGHT - 1) / 2) / FOCAL, np.ones(x.shape)], -1)
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


def radiance_of_sky(d: np.ndarray) -> np.ndarray:
    """[..., 3] by unit direction: a gradient and a broad lobe."""
    lobe = np.exp(12 * (d @ (np.array([2.0, -2.0, -1.0]) / 3) - 1))
    return np.stack([0.5 + 0.3 * d[..., 0], 0.5 - 0.3 * d[..., 1], 0.6 + 0.4 * d[..., 1] * d[..., 2]], -1) + (
        lobe[..., None] * [4.0, 3.0, 2.0]
    )


def rectangle(centre, half_u, half_v, **more):
    """Faces half_u x half_v."""
    u, v = np.array(half_u, float), np.array(half_v, float)
    normal = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
    matrix = np.eye(4)
    matrix[:3] = np.stack([u, v, normal, np.array(centre, float)], 1)
    return {"type": "rectangle", "to_world": mi.ScalarTransform4f(matrix), **more}


def diffuse(r, g, b):
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [r, g, b]}}}


def metal(alpha):
    """GGX that reflects all light, separable masking."""
    return {"type": "roughconductor", "material": "none", "distribution": "ggx", "alpha": alpha}


def lamp(centre, half_u, half_v, radiance):
    glow = {"type": "area", "radiance": {"type": "rgb", "value": radiance}}
    return rectangle(centre, half_u, half_v, emitter=glow)


def sky():
    """Mitsuba's map has +y up and starts at -z, turning to +x."""
    h, w = 256, 512
    theta, phi = np.meshgrid((np.arange(h) + 0.5) / h * np.pi, (np.arange(w) + 0.5) / w * 2 * np.pi, indexing="ij")
    d = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)], -1)
    return {"type": "envmap", "bitmap": mi.Bitmap(radiance_of_sky(d).astype(np.float32))}


def scenes():
    grey, red, green = diffuse(0.7, 0.7, 0.7), diffuse(0.6, 0.1, 0.1), diffuse(0.1, 0.5, 0.15)
    block = {"type": "cube", "bsdf": diffuse(0.8, 0.6, 0.3)}
    turn = mi.ScalarTransform4f().translate([0.35, 0.7, 2.9]).rotate([0, 1, 0], 30).scale(0.3)
    box = {
        "floor": rectangle((0, 1, 2.5), (1.2, 0, 0), (0, 0, 1.5), bsdf=grey),
        "ceiling": rectangle((0, -1, 2.5), (1.2, 0, 0), (0, 0, 1.5), bsdf=grey),
        "back": rectangle((0, 0, 4), (1.2, 0, 0), (0, 1, 0), bsdf=grey),
        "left": rectangle((-1.2, 0, 2.5), (0, 1, 0), (0, 0, 1.5), bsdf=red),
        "right": rectangle((1.2, 0, 2.5), (0, 1, 0), (0, 0, 1.5), bsdf=green),
        "block": {**block, "to_world": turn},
        "lamp": lamp((0, -0.98, 2.6), (0.4, 0, 0), (0, 0, -0.3), [12.0, 10.0, 7.0]),
    }
    plane = {"plane": rectangle((0, 1, 4), (4, 0, 0), (0, 0, 3.5), bsdf=metal(0.2))}
    shone_on = {**plane, "lamp": lamp((0.5, -1, 6), (0.8, 0, 0), (0, -0.36, -0.48), [5.0, 3.0, 2.0])}
    intensity = {"type": "rgb", "value": [5.0, 4.0, 3.0]}
    glint = {**plane, "bulb": {"type": "point", "position": [0.5, -1.0, 5.0], "intensity": intensity}}
    ball = {"type": "sphere", "center": [0, 0, 3.0], "radius": 1.0}
    return {
        "box": box,
        "gloss_area": shone_on,
        "gloss_point": glint,
        "sky_diffuse": {"ball": {**ball, "bsdf": diffuse(0.7, 0.5, 0.3)}, "sky": sky()},
        "sky_gloss": {"ball": {**ball, "bsdf": metal(0.2)}, "sky": sky()},
        "sky_seen": {"sky": sky()},
    }


def measure(description, samples: int) -> tuple[np.ndarray, np.ndarray]:
    scene = mi.load_dict({"type": "scene", **description})
    integrator = mi.load_dict({"type": "path", "max_depth": 2})
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
    for name, description in scenes().items():
        samples = 1 if name in ("sky_seen", "gloss_point") else SAMPLES
        out[name], out[f"{name}_error"] = (a.astype(np.float32) for a in measure(description, samples))
        print(name, out[name].mean((0, 1)), out[f"{name}_error"].mean(), file=sys.stderr)
    np.savez_compressed(Path(__file__).parent / "reference.npz", **out)


if __name__ == "__main__":
    main()
