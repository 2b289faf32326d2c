"""The drivers through pyusb and the real libusb, single reads and queued ones, on a kernel faked by umockdev."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import site
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from usb_rig import random_recording

from evis.events import Imu, open_writer
from nodes.camera.usb.models import MODELS

ROOT = Path(__file__).parents[3]
SYSTEM_PYTHON = "/usr/bin/python3"
TRY = (
    "import sys, gi; gi.require_version('UMockdev', '1.0'); from gi.repository import UMockdev; "
    "print(sys.version_info[:2])"
)


@pytest.fixture(scope="module")
def wrapper() -> str:
    """`umockdev-wrapper`, where it and a system Python of this version with its bindings are."""
    program = shutil.which("umockdev-wrapper")
    if program is None or not Path(SYSTEM_PYTHON).exists():
        pytest.skip("no umockdev here (Debian: umockdev, gir1.2-umockdev-1.0, python3-gi)")
    found = subprocess.run([SYSTEM_PYTHON, "-c", TRY], capture_output=True, text=True)
    if found.returncode or found.stdout.strip() != str(tuple(sys.version_info[:2])):
        pytest.skip(
            f"the system's Python has no umockdev bindings or is not {sys.version_info[0]}.{sys.version_info[1]}"
        )
    return program


def drive(wrapper: str, name: str, path: Path, transfers: str, faults: str = "") -> dict:
    """What usbfs_rig.py printed."""
    paths = os.pathsep.join([str(ROOT), *site.getsitepackages()])
    command = [
        wrapper,
        SYSTEM_PYTHON,
        str(Path(__file__).with_name("usbfs_rig.py")),
        name,
        str(path),
        transfers,
        faults,
    ]
    run = subprocess.run(command, capture_output=True, text=True, timeout=600, env={**os.environ, "PYTHONPATH": paths})
    assert run.returncode == 0, run.stderr[-2000:]
    return json.loads(run.stdout.strip().splitlines()[-1])


@pytest.mark.parametrize(
    ("name", "transfers"),
    [
        ("silkyevcam", "single"),
        ("silkyevcam", "queued"),
        ("evk4", "queued"),
        ("davis346", "queued"),
        ("dvxplorer", "single"),
        ("dvxplorer_mini", "queued"),
        ("dvs128", "queued"),
    ],
)
def test_stream_over_libusb(wrapper, name, transfers, tmp_path):
    """Found, opened, asked, configured and read through libusb: every event, in order; then it is unplugged."""
    model = MODELS[name]
    sent = random_recording(tmp_path / "a.npz", model.width, model.height, 5000)
    digest = hashlib.sha256()
    for array in (sent.t // 1000, sent.x, sent.y, sent.p):
        digest.update(array.tobytes())
    got = drive(wrapper, name, tmp_path / "a.npz", transfers)
    if name == "dvxplorer_mini":  # sent in small pieces, later than its clock: packets were closed before they came
        got["counters"].pop("events_stepped_back", 0)
    assert (got["name"], got["serial"], got["counters"]) == (name, "0000e915", {})
    assert (got["events"], got["sha256"]) == (len(sent), digest.hexdigest())
    assert "unplugged in mid-stream" in got["end"]


@pytest.mark.parametrize("transfers", ["single", "queued"])
def test_stalls_over_libusb(wrapper, transfers, tmp_path):
    """Cleared, counted, and the stream goes on to its end."""
    sent = random_recording(tmp_path / "a.npz", 346, 260, 10_000)
    got = drive(wrapper, "davis346", tmp_path / "a.npz", transfers, "short=2048,stall_every=9")
    assert got["counters"]["stalls"] >= 2 and got["counters"]["gaps"] >= 1
    assert 0.5 * len(sent) < got["events"] <= len(sent)


@pytest.mark.parametrize("transfers", ["single", "queued"])
def test_samples_beside_the_stream_over_libusb(wrapper, transfers, tmp_path):
    """A Mini's inertial samples come by interrupt transfers while events come by bulk transfers."""
    events = random_recording(tmp_path / "a.npz", 640, 480, 3000, 40_000)
    n = 20
    events.imu = Imu(
        np.arange(1, n + 1) * 2_000_000, np.arange(3.0 * n).reshape(n, 3), np.ones((n, 3)), np.full(n, 25.0)
    )
    with open_writer(tmp_path / "a.aedat4", 640, 480) as writer:
        writer.write(events)
    got = drive(wrapper, "dvxplorer_mini", tmp_path / "a.aedat4", transfers)
    assert (got["events"], got["samples"]) == (3000, n)
    np.testing.assert_allclose(got["acceleration"], events.imu.acceleration.sum(), rtol=1e-3)
