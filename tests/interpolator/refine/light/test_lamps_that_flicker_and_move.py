"""Light of a lamp that flickers while it goes away, so that the later keyframe shows little of it, against the closed
form."""

from dataclasses import replace

import numpy as np
import pytest
from refine_rig import refined
from rigid_rig import GAP, START, lamp, plain, pose, quad, world

from evis.scene.model import Waveform
from evis.scene.motion import Linear, Prescribed
from nodes.renderer.lights.lights import waveform_strengths

K, WALL, ALBEDO, SKY, LN = 4, 3.0, 0.5, 1.0, 0.05
FREQUENCY, DUTY = 1500.0, 0.4
SPEED, NEAR, INTENSITY = 3000.0, 1.0, 4.0
"""Of the lamp [m/s, m, W/sr]: at the end of the gap it is 31 m away, and has 0.1 % of the sky's light."""


@pytest.mark.parametrize("kind", ["square", "sine"])
def test_flicker_is_followed_that_the_later_keyframe_does_not_show(kind):
    """Irradiance of a point source: I cos / r^2, times its strength."""
    flicker = Waveform(kind, FREQUENCY, 0.9, duty=DUTY)
    away = Prescribed(pose(0, 0.2, WALL - NEAR + SPEED * START * 1e-9), [Linear(np.array([0.0, 0.0, -SPEED]))])
    scene = world([(quad(6.0), plain(ALBEDO), Prescribed(pose(z=WALL)))], spares=[("stand", away)], sky=SKY)
    given = {"colour": np.full(3, INTENSITY), "vector": np.zeros(3), "waveform": flicker, "shadows": False, "body": 1}
    scene.lights.append(replace(lamp(), **given))
    frames, (at, offset, value) = refined(scene, K, 100_000, tolerance=LN)

    since = np.arange(0, GAP, 5_000)
    phase = (since + START) * 1e-9 * FREQUENCY % 1.0
    switch = np.abs(phase[:, None] - [0.0, DUTY, 1.0]).min(1) / FREQUENCY
    # A switch takes a thirty-second of the time between two instants.
    since = since[(since > GAP // 50) & (switch > 15e-6)]
    strength = waveform_strengths([flicker], START + since)[:, 0]
    view = scene.cameras[0]
    for pixel in range(0, view.width * view.height, 97):
        y, x = divmod(pixel, view.width)
        point = WALL * np.array([(x - view.k[0, 2]) / view.k[0, 0], (y - view.k[1, 2]) / view.k[1, 1], 1.0])
        way = np.stack([0 * since, 0.2 + 0 * since, WALL - NEAR - SPEED * since * 1e-9], -1) - point
        irradiance = strength * INTENSITY * -way[:, 2] / np.linalg.norm(way, axis=-1) ** 3
        truth = np.log(ALBEDO * (SKY + irradiance / np.pi))
        times = np.concatenate([np.arange(1, K + 1) * GAP / K, offset[at == pixel]])
        values = np.concatenate([frames.reshape(K, -1)[:, pixel], value[at == pixel]])
        order = np.argsort(times, kind="stable")
        seen = np.interp(since, times[order], np.log(values[order].astype(np.float64)))
        assert np.abs(seen - truth).max() < 2.5 * LN
