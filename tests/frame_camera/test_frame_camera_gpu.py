"""The same images on a GPU: without noise value by value, with noise the same draws; no frame leaves the device."""

import numpy as np
import pytest
import warp as wp
from films import MS, film

import evis

pytestmark = [
    pytest.mark.gpu,
    pytest.mark.skipif(not wp.is_cuda_available(), reason="there is no CUDA device here"),
]
LIGHT = np.linspace(0.0, 1.5, 48 * 64).reshape(48, 64)


def light(t):
    """Something that changes in each pixel at another rate."""
    return LIGHT * (1.0 + 0.01 * t * np.linspace(0, 1, 64))


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"rolling_shutter_us": 100.0, "image_gamma": 2.2},
        {"defocus_px": 1.5},
        {"preset": "davis346", "image_bits": 16, "exposure_ms": 3.0, "full_well": 1e5},
    ],
)
def test_a_gpu_makes_the_images_of_the_cpu(given):
    asked = {"image_rate": 100.0, "envs": 2, "seed": 5, **given}
    here, camera = film(light, 100, 10, 4, **asked)
    there, other = film(light, 100, 10, 4, device="cuda", **asked)
    assert len(here) == len(there) == 20
    # Logarithms of the two differ in the last bit: with noise here and there an electron more or less.
    assert other.clipped == pytest.approx(camera.clipped, abs=20 if "preset" in given else 0)
    assert other.nonfinite == camera.nonfinite == 0
    for a, b in zip(here, there):
        assert (a.env, a.number) == (b.env, b.number) and abs(a.exposure_ns - b.exposure_ns) < 0.001 * MS
        difference = np.abs(a.pixels.astype(int) - b.pixels)
        assert np.count_nonzero(difference > 2) <= 1e-3 * difference.size


def test_a_whole_graph_on_a_gpu():
    asked = {
        "width": 64,
        "height": 48,
        "image_rate": 60.0,
        "exposure_ms": 4.0,
        "outputs": ["events", "image"],
        "envs": 3,
    }
    found = []
    for device in ("cpu", "cuda"):
        with evis.Simulation("spinning_disk", device=device, **asked) as sim:
            found.append([image for step in sim.run(0.1) for image in step.images])
    assert len(found[0]) == len(found[1]) == 18
    for a, b in zip(*found, strict=True):
        assert (a.env, a.header.stamp_ns) == (b.env, b.header.stamp_ns)
        assert np.abs(a.data.astype(int) - b.data).mean() < 1.0
