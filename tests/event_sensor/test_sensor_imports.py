"""A sensor imports the kernels of what it has, and of nothing else."""

import json
import subprocess
import sys

import pytest

PROGRAM = """
import json, sys
import numpy as np
from nodes.event_sensor.sensor import EventSensor
sensor = EventSensor(4, 4, **json.loads(sys.argv[1]))
sensor.process(np.ones((1, 2, 4, 4), np.float32), np.array([1, 2]), np.zeros(1, np.int32))
print("\\n" + json.dumps([name for name in sys.modules if name.startswith("nodes.event_sensor.")]))
"""
FAULTS = {
    "engines.nonideal",
    "cpu.nonideal_kernels",
    "model.pixel_kernels",
    "model.pixel_step_kernels",
    "model.curve_kernels",
}
PARTS = {
    "faults": FAULTS,
    "random": {"model.faults.random_kernels"},
    "paper": {"model.paper_kernels", "engines.paper"},
    "defocus": {"optics.defocus", "optics.defocus_kernels"},
    "photoreceptor": {"optics.photoreceptor", "optics.photoreceptor_kernels", "optics.photoreceptor_simd_kernels"},
    "noise": {
        "optics.photoreceptor_noise",
        "optics.photoreceptor_noise_kernels",
        "optics.filtered_noise_kernels",
    },
    "readout": {"readout.readout", "readout.readout_kernels"},
    "models": {"peers", "peers.v2e", "peers.esim"},
}
"""Modules of what an ideal sensor lacks."""


@pytest.mark.parametrize(
    "given, has",
    [
        ({}, set()),
        ({"leak_rate": 1.0}, {"faults", "random"}),
        ({"crossing": "cubic"}, {"faults", "random"}),
        ({"defocus_px": 0.5, "bandwidth_hz": 100.0}, {"defocus", "photoreceptor"}),
        ({"photoreceptor_noise": 0.1, "bandwidth_hz": 100.0}, {"photoreceptor", "noise", "random"}),
        ({"readout_rate": 1e6}, {"readout"}),
    ],
)
def test_a_sensor_imports_the_kernels_of_what_it_has(given, has):
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, json.dumps(given)], capture_output=True, text=True, timeout=600, check=True
    )
    there = {name.removeprefix("nodes.event_sensor.") for name in json.loads(done.stdout.splitlines()[-1])}
    assert {part for part, modules in PARTS.items() if modules <= there} == has
    for part, modules in PARTS.items():
        assert part in has or not modules & there, part
