"""Radiance of a logarithm, against float64, also where a GPU computes fast and not to the last place."""

import numpy as np
import pytest
import warp as wp

from nodes.interpolator.rigid.look_up.log_kernels import BLACK, light

DEVICES = [("cpu", False), pytest.param(("cuda:0", True), marks=pytest.mark.gpu)]
LARGEST = float(np.log(np.finfo(np.float32).max))


def kernel_of(fast):
    @wp.kernel(module="unique", enable_backward=False, module_options={"fast_math": fast})
    def radiance(value: wp.array(dtype=float), out: wp.array(dtype=float)):
        """Computes the radiance of logarithms."""
        n = wp.tid()
        out[n] = light(value[n])

    return radiance


@pytest.mark.parametrize("how", DEVICES)
def test_radiance_of_logarithms_from_black_to_the_largest_number(how):
    """To 4e-7, three units in the last place: a step of ln I that a sensor would not notice."""
    device, fast = how
    value = np.linspace(float(BLACK), LARGEST - 1e-4, 500_001).astype(np.float32)[1:]
    value = np.concatenate([value, np.linspace(-0.01, 0.01, 20_001).astype(np.float32)])
    out = wp.empty(value.size, dtype=float, device=device)
    wp.launch(kernel_of(fast), value.size, [wp.array(value, device=device), out], device=device)
    assert np.abs(out.numpy() / np.exp(value.astype(np.float64)) - 1).max() < 4e-7


@pytest.mark.parametrize("how", DEVICES)
def test_black_has_no_radiance(how):
    device, fast = how
    value = np.array([float(BLACK), -70.0, -np.inf], np.float32)
    out = wp.empty(3, dtype=float, device=device)
    wp.launch(kernel_of(fast), 3, [wp.array(value, device=device), out], device=device)
    assert (out.numpy() == 0).all()
