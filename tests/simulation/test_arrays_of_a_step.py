"""What a caller gets of a step is its own: any number of images, arrays to write to, seeds that it may use again."""

import numpy as np
import pytest

import evis

SMALL = {"width": 16, "height": 12, "audit": 0, "keyframe_rate": 20, "upsampling": 2}


@pytest.mark.parametrize("given", [{"envs": 65}, {"image_rate": 1500}])
def test_a_step_has_any_number_of_images(given):
    """A topic lends 64 slots at most."""
    with evis.Simulation("spinning_disk", outputs=["image"], exposure_ms=0.1, **SMALL, **given) as sim:
        sim.reset()
        found = [sim.step().images for _ in range(2)]
    for images in found:
        assert len(images) > 64
        assert len({image.data.ctypes.data for image in images}) == len(images)


def test_what_is_done_to_a_step_changes_nothing_of_the_run():
    def events(scribble):
        with evis.Simulation("spinning_disk", outputs=["events", "state"], **SMALL) as sim:
            step = sim.reset(seed=3)
            found = []
            for _ in range(3):
                if scribble:
                    step.state.end_pose[..., :3] -= 0.5
                    step.state.moving[:] = 0
                step = sim.step()
                found.append(step.events)
        return found

    for a, b in zip(events(False), events(True)):
        np.testing.assert_array_equal(a.t, b.t)
        np.testing.assert_array_equal(a.x, b.x)


def test_episodes_of_a_step_may_be_written_to():
    with evis.Simulation("falling_objects", envs=2, outputs=["events"], **SMALL) as sim:
        sim.reset()
        sim.step()
        step = sim.reset(envs=[1])
        step.episodes[:] = 0
        sim.step()


def test_a_saved_bag_is_of_the_seeds_of_the_run_whatever_became_of_their_arrays(tmp_path):
    envs, seeds = np.array([1]), np.array([5])
    with evis.Simulation("falling_objects", envs=2, outputs=["events"], **SMALL) as sim:
        sim.reset(seed=1)
        sim.step()
        sim.reset(envs=envs, seed=seeds)
        envs[:], seeds[:] = 0, 77
        sim.step()
        last = sim.step().events
        offsets = np.array(last.env_offsets)
        sim.save(tmp_path / "run.mcap")
    for env in range(2):
        with evis.open(tmp_path / "run.mcap", topic=f"/env{env}/cam0/events") as recording:
            t = np.concatenate([packet.t for packet in recording])
        mine = last.t[offsets[env] : offsets[env + 1]]
        np.testing.assert_array_equal(t[len(t) - len(mine) :], mine)


def test_alone_tells_the_seed_of_a_reset():
    given = SMALL | {"outputs": ["events", "info"], "preset": "davis346"}
    with evis.Simulation("falling_objects", envs=2, **given) as sim:
        assert sim.alone(sim.reset(seed=[10, 20]), 1).info.sensor["seed"] == 20
        assert sim.alone(sim.reset(seed=10), 1).info.sensor["seed"] == 11
