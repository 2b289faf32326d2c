"""What is observed against what the simulation gave, worked out again in numpy."""

from pathlib import Path

import numpy as np
import pytest

import evis
import evis.env
from evis.env.task import SMALL

SEED, STEPS = 11, 6
TAU = 0.05
PARTS = {
    "voxels": evis.env.VoxelGrid(4),
    "pooled": evis.env.VoxelGrid(4, pool=(8, 4)),
    "counts": evis.env.CountImage(),
    "signed": evis.env.CountImage(polarity="signed"),
    "surface": evis.env.TimeSurface(tau=TAU),
    "raw": evis.env.RawEvents(3000),
    "few": evis.env.RawEvents(5),
    "grey": evis.env.Frames(),
    "colour": evis.env.Frames(grey=False),
    "poses": evis.env.Poses(("pole",)),
}


@pytest.fixture(scope="module")
def observed() -> tuple[list, list]:
    """Steps of an environment, and those of a simulation that was pushed alike."""
    env = evis.env.EventEnv("CartPole", observation=PARTS)
    first, _ = env.reset(seed=SEED)
    assert env.observation_space.contains(first)
    seen = [env.step(np.ones(1))[0] for _ in range(STEPS)]
    assert all(env.observation_space.contains(one) for one in seen)
    env.close()
    with evis.Simulation("cart_pole", outputs=("events", "keyframe", "state"), seed=SEED, **SMALL) as simulation:
        simulation.reset()
        steps = [simulation.step([10.0]) for _ in range(STEPS)]
    return seen, steps


def test_raw_events_are_those_of_a_run_with_the_seed(observed) -> None:
    for seen, step in zip(*observed):
        rows = seen["raw"][seen["raw"][:, 3] >= 0]
        e = step.events
        wanted = np.stack((step.stamp_ns - e.t, e.x, e.y, e.p), axis=1)
        np.testing.assert_array_equal(rows, wanted)
        assert (seen["raw"][len(wanted) :] == -1).all()
        few = seen["few"][seen["few"][:, 3] >= 0]
        np.testing.assert_array_equal(few, wanted[-5:])
    assert len(wanted) > 100


def test_counts(observed) -> None:
    for seen, step in zip(*observed):
        wanted = np.zeros((2, 64, 64))
        np.add.at(wanted, (step.events.p, step.events.y, step.events.x), 1)
        np.testing.assert_array_equal(seen["counts"], wanted)
        np.testing.assert_array_equal(seen["signed"][0], wanted[1] - wanted[0])


def test_voxels_keep_the_sum_of_events(observed) -> None:
    """Weights of an event add up to 1, so the sum over bins is the signed count; pooling keeps sums."""
    for seen, _ in zip(*observed):
        np.testing.assert_allclose(seen["voxels"].sum(axis=0), seen["signed"][0], atol=1e-4)
        wanted = seen["voxels"].reshape(4, 8, 8, 16, 4).sum(axis=(2, 4))
        np.testing.assert_allclose(seen["pooled"], wanted, atol=1e-4)


def test_the_surface_outlasts_steps(observed) -> None:
    latest = np.full((2, 64, 64), -np.inf)
    for seen, step in zip(*observed):
        np.maximum.at(latest, (step.events.p, step.events.y, step.events.x), step.events.t)
        np.testing.assert_allclose(
            seen["surface"], np.exp((latest - step.stamp_ns) / (TAU * 1e9)), rtol=1e-4, atol=1e-6
        )


def test_frames_are_srgb(observed) -> None:
    """IEC 61966-2-1 of half the radiance."""
    for seen, step in zip(*observed):
        light = np.clip(np.asarray(step.keyframe[0], np.float64) * 0.5, 0, 1)
        code = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
        assert np.abs(seen["colour"] - 255 * code).max() <= 0.51
        assert seen["grey"].shape == (64, 64, 1) and seen["grey"].std() > 20


def test_poses(observed) -> None:
    for seen, step in zip(*observed):
        pole = step.state.end_pose[0, step.state.names.index("pole")]
        np.testing.assert_array_equal(seen["poses"], pole[None].astype(np.float32))


def test_a_surface_forgets_at_a_reset() -> None:
    env = evis.env.EventEnv("CartPole", width=32, height=32)
    env.reset(seed=1)
    assert np.any([env.step(np.ones(1))[0] for _ in range(8)])
    assert not env.reset()[0].any()
    env.close()


def test_the_last_action_is_forgotten_at_a_reset() -> None:
    """Of one environment alone, too."""
    env = evis.env.EventVectorEnv(
        "CartPole", 2, observation=evis.env.LastAction(), autoreset_mode="Disabled", width=32, height=32, seconds=0.06
    )
    assert env.single_observation_space == env.single_action_space
    assert not env.reset(seed=1)[0].any()
    for push in (0.25, -0.5, 1.0):
        seen, _, _, truncated, _ = env.step(np.array([[push], [-push]], np.float32))
        np.testing.assert_array_equal(seen, [[push], [-push]])
    assert truncated.all()
    seen, _ = env.reset(options={"reset_mask": np.array([True, False])})
    np.testing.assert_array_equal(seen, [[0], [-1]])
    env.close()


def test_cameras_of_different_sizes_and_none_at_all(tmp_path: Path) -> None:
    (tmp_path / "slide.xml").write_text(
        "<mujoco><worldbody><body name='b'><joint name='j' type='slide'/><geom size='0.1'/></body></worldbody>"
        "<actuator><motor joint='j' ctrlrange='-1 1' ctrllimited='true'/></actuator></mujoco>"
    )
    (tmp_path / "slide.yaml").write_text(
        "mjcf: slide.xml\ncameras:\n  near: {position: [1, 0, 0], look_at: [0, 0, 0], fov: 50 deg}\n"
        "  far: {position: [3, 0, 0], look_at: [0, 0, 0], fov: 50 deg, width: 40, height: 24}\n"
    )

    def shapes(given: dict[str, str], **observation: evis.env.Observation) -> dict[str, tuple[int, ...]]:
        task = evis.env.Task(str(tmp_path / "slide.yaml"), observation)
        env = evis.env.EventEnv(task, width=32, height=16, upsampling=1, interpolator="none", **given)
        seen, _ = env.reset(seed=1)
        assert env.observation_space.contains(seen)
        env.close()
        return {name: value.shape for name, value in seen.items()}

    counts = evis.env.CountImage
    assert shapes({"cameras": "near,far"}, far=counts(camera="far"), first=counts()) == {
        "far": (2, 24, 40),
        "first": (2, 16, 32),
    }
    assert shapes({}, joints=evis.env.Joints(), did=evis.env.LastAction()) == {"joints": (2,), "did": (1,)}
