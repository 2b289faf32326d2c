"""Cameras of a rig have noise of their own, and each has it by itself, beside others and after a reset alike."""

from __future__ import annotations

from typing import Any

import evis

RIG = {"width": 32, "height": 24, "keyframe_rate": 30, "upsampling": 1, "interpolator": "none"}
NOISY = {"shot_rate": 20.0, "hot_pixel_fraction": 0.02, "hot_pixel_rate": 500.0, "timestamp_jitter_us": 20.0}


def events(packet: Any, env: int = 0, origin: int = 0) -> list[tuple[int, ...]]:
    """(t, x, y, p) of an environment, t from the origin on."""
    own = slice(*packet.env_offsets[env : env + 2].tolist())
    columns = (packet.t - origin, packet.x, packet.y, packet.p)
    return list(zip(*(column[own].tolist() for column in columns)))


def test_sensors_of_one_rig_have_noise_of_their_own() -> None:
    """With so high a threshold all events are noise; none is in both cameras at the same instant."""
    still = {"scene": "stereo_room", "cameras": ["left", "right"], "seed": 3, **RIG, **NOISY}
    with evis.Simulation("simulator", threshold=3.0, **still) as sim:
        steps = [sim.step() for _ in range(5)]
    left, right = ({e for s in steps for e in events(s.cameras[name].events)} for name in ("left", "right"))
    assert min(len(left), len(right)) > 1000 and not left & right


def test_noise_of_a_camera_is_the_same_beside_others_and_after_a_reset() -> None:
    given = {**RIG, **NOISY, "outputs": ["right.events"]}
    with evis.Simulation("stereo_room", seed=9, cameras=["right"], **given) as sim:
        alone = [events(sim.step().events) for _ in range(3)]
    with evis.Simulation("stereo_room", seed=8, envs=2, **given) as sim:
        beside = [events(sim.step().cameras["right"].events, 1) for _ in range(3)]
        origin = sim.reset(envs=[0], seed=[9]).stamp_ns
        after = [events(sim.step().cameras["right"].events, 0, origin) for _ in range(3)]
    assert alone == beside == after
