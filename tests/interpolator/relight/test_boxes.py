"""What may be in the way of light, by boxes: never missed."""

import numpy as np
import warp as wp

from nodes.interpolator.relight.boxes_kernels import box_met


@wp.kernel(enable_backward=False)
def meet(
    lower: wp.array(dtype=wp.vec3),
    upper: wp.array(dtype=wp.vec3),
    ray: wp.array(dtype=wp.vec3),
    met: wp.array(dtype=int),
):
    """Tells which rays of length 2 meet their boxes."""
    n = wp.tid()
    if box_met(lower[n], upper[n], ray[n], 2.0):
        met[n] = 1


def test_a_ray_meets_a_box_as_its_points_lie_in_it():
    """Points every 1/2000 of the ray: one inside means a hit; a hit without any passes within a step of the box."""
    rng = np.random.default_rng(5)
    count = 3000
    middle, half = rng.uniform(-1.5, 1.5, (count, 3)), rng.uniform(0.0, 0.8, (count, 3))
    ray = rng.normal(size=(count, 3))
    ray[: count // 4, rng.integers(0, 3)] = 0.0
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    met = wp.zeros(count, dtype=int, device="cpu")
    arrays = [wp.array(v.astype(np.float32), dtype=wp.vec3, device="cpu") for v in (middle - half, middle + half, ray)]
    wp.launch(meet, count, [*arrays, met], device="cpu")
    at = np.linspace(0, 2, 2001)[None, :, None] * ray[:, None]
    away = (np.abs(at - middle[:, None]) - half[:, None]).max(-1).min(1)
    found = met.numpy().astype(bool)
    assert not (~found & (away < -1e-5)).any(), "nothing that is in the way is missed"
    assert not (found & (away > 2e-3)).any()
    assert 0.05 < found.mean() < 0.95
