"""What Gymnasium's own checks say of the environments, and that a seed decides an episode."""

import copy
import importlib
import pickle
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import evis
import evis.env
from evis.scene import load_scene


@pytest.mark.parametrize("name", list(evis.env.TASKS))
def test_gymnasium_has_nothing_to_object(name: str) -> None:
    env = gymnasium.make(f"evis/{name}-v0", width=32, height=32)
    check_env(env.unwrapped)
    env.close()


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickle.dumps])
@pytest.mark.parametrize("made", [evis.env.EventEnv, evis.env.EventVectorEnv])
def test_an_environment_that_is_copied_says_that_it_cannot_be(copied: Callable[[Any], object], made: Any) -> None:
    """A copy alone would have the simulation of the first one, and every step of either would be one of both."""
    env = made("CartPole", render_mode="rgb_array", width=32, height=32)
    env.reset(seed=1)
    with pytest.raises(evis.SimulationError, match=r"an environment cannot be copied or pickled; .*gymnasium\.make"):
        copied(env)
    env.close()


def test_what_was_closed_says_so_whatever_is_asked() -> None:
    """Also behind a step that was refused for that: `reset()` begins nothing anew."""
    env = evis.env.EventEnv("CartPole", width=32, height=32)
    env.reset(seed=1)
    state = env.state()
    env.close()
    for call in (lambda: env.step(np.zeros(1, np.float32)), env.state, env.reset, lambda: env.restore(state)) * 2:
        with pytest.raises(evis.SimulationError, match=r"^the simulation is closed; make another one$"):
            call()


def episode(env: gymnasium.Env, seed: int | None) -> np.ndarray:
    observed = [env.reset(seed=seed)[0]]
    env.action_space.seed(0)
    return np.stack([*observed, *(env.step(env.action_space.sample())[0] for _ in range(10))])


def test_a_seed_decides_an_episode_and_without_one_the_next_begins() -> None:
    env = gymnasium.make("evis/CartPole-v0", width=32, height=32).unwrapped
    first, second, again, other = (episode(env, seed) for seed in (5, None, 5, 6))
    assert (first == again).all() and first[1:].any()
    assert (first != second).any() and (first != other).any() and (second != other).any()
    env.close()


def test_render_shows_the_camera_with_events() -> None:
    env = gymnasium.make("evis/CartPole-v0", render_mode="rgb_array")
    env.reset(seed=1)
    still = env.render()
    assert still.shape == (256, 256, 3) and still.dtype == np.uint8
    assert still[30, 30].min() > 100 and still.min() < 60, "a bright wall, a dark pole"
    for _ in range(10):
        env.step(np.ones(1, np.float32))
    moved = env.render()
    assert not (moved[..., 0] == moved[..., 2]).all(), "events have colours"
    env.close()
    quiet = gymnasium.make("evis/CartPole-v0").unwrapped
    quiet.reset()
    assert quiet.render() is None
    quiet.close()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"task": "CartPool"}, "no task 'CartPool'; there are CartPole"),
        ({"observation": {}}, "nothing is observed"),
        ({"observation": evis.env.CountImage(pool=7)}, "pool=7 does not divide an image of 64 x 64"),
        ({"observation": evis.env.CountImage(pool=(2, 2, 2))}, "is neither a side nor rows and columns"),
        ({"observation": evis.env.RawEvents(0)}, "most is 0; it must be a whole number, 1 or more"),
        ({"observation": evis.env.RawEvents(1.5)}, "most is 1.5; it must be a whole number"),  # type: ignore[arg-type]
        ({"observation": evis.env.VoxelGrid(2.5)}, "bins is 2.5; it must be a whole number"),  # type: ignore[arg-type]
        ({"observation": evis.env.VoxelGrid(normalise="x")}, "normalise is 'x'; it must be True"),  # type: ignore[arg-type]
        (
            {"observation": evis.env.VoxelGrid(polarity="both")},
            "polarity is 'both'; it must be signed, split or merged",
        ),
        ({"observation": evis.env.CountImage(polarity="both")}, "polarity is 'both'; it must be signed"),
        ({"observation": evis.env.Frames(grey="no")}, "grey is 'no'; it must be True or False"),  # type: ignore[arg-type]
        ({"normalise": "x"}, "normalise is 'x'; it must be True or False"),
        ({"observation": evis.env.CountImage(pool=2.0)}, "pool=2.0 is neither a side"),  # type: ignore[arg-type]
        ({"observation": evis.env.TimeSurface(tau=-1)}, "tau is -1; it must be a number of seconds above 0"),
        ({"observation": evis.env.Poses(("cat",))}, "no body 'cat'; there are cart, pole"),
        ({"observation": evis.env.Poses("pole")}, "bodies is 'pole'; names come several"),  # type: ignore[arg-type]
        ({"observation": evis.env.TimeSurface("1")}, "tau is '1'; it must be a number"),  # type: ignore[arg-type]
        ({"observation": evis.env.Frames(exposure=-1)}, "exposure is -1; it must be a number above 0"),
        ({"observation": evis.env.Frames(exposure=float("nan"))}, "exposure is nan; it must be a number above 0"),
        (
            {"observation": evis.env.Frames(grey=False), "keyframes": "luminance"},
            "keyframes=luminance has none",
        ),
        ({"observation": [evis.env.Joints()]}, "several are observations by name"),
        ({"observation": {"": evis.env.Joints(), "events": evis.env.CountImage()}}, "by name, no name being empty"),
        ({"max_episode_steps": 0}, "max_episode_steps is 0; it must be a whole number, 1 or more, or -1"),
        ({"task": evis.env.Task}, "it must be a Task, or the name of one: CartPole"),
        ({"seconds": "5"}, "seconds is '5'; an episode takes some time"),
        ({"seed": 4}, r"seed is no argument of an environment; reset\(seed=3\) says it"),
        ({"envs": 4}, r"envs is no argument of an environment; gymnasium.make_vec\(..., num_envs=4\)"),
        ({"action_rate": 25}, "action_rate is no argument of an environment; there is an action for every step"),
        *(
            ({"observation": seen, "camera_rate": ["cam0=25"]}, r"in every 2\. step alone, at 25 Hz; .* 50 a second")
            for seen in (
                evis.env.CountImage(),
                evis.env.VoxelGrid(),
                evis.env.TimeSurface(),
                evis.env.RawEvents(),
                evis.env.Frames(),
            )
        ),
        ({"outputs": ("events",)}, "outputs is no argument of an environment; what is observed says"),
        ({"render_mode": "human"}, "rgb_array"),
        ({"seconds": -1}, "seconds is -1; an episode takes some time"),
        ({"seconds": float("nan")}, "seconds is nan; an episode takes some time"),
        ({"crossing": "cubic", "upsampling": 4, "interpolator": "rigid"}, "crossing=cubic gives events one frame late"),
        ({"widht": 3}, "widht"),
    ],
)
def test_what_cannot_be_made_is_named(options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        evis.env.EventEnv(**{"task": "CartPole", **options})


@pytest.mark.parametrize(("name", "first", "other"), [("model", "evis", "evis-paper"), ("crossing", "linear", "cubic")])
def test_a_seed_may_draw_another_sensor_whose_events_are_not_late(
    name: str, first: str, other: str, tmp_path: Path
) -> None:
    """Than the constructor's seed, 0, does; and gives the events that a simulation with it gives."""
    (tmp_path / "slide.xml").write_text(
        "<mujoco><worldbody><body name='b'><joint name='j' type='slide'/><geom size='0.1'/></body></worldbody>"
        "<actuator><motor joint='j' ctrlrange='-1 1' ctrllimited='true'/></actuator></mujoco>"
    )
    scene = tmp_path / "drawn.yaml"
    for one, another in ((first, other), (other, first)):  # whichever half of the draws seed 0 is in
        scene.write_text(
            "mjcf: slide.xml\nargs: {drawn: {default: {from: 0, to: 2}, help: which sensor}}\nenvironment: 0.3\n"
            "initial_joints: {j: {velocity: [1, 1]}}\n"
            "cameras: {cam0: {position: [0, 1, 0], look_at: [0, 0, 0], fov: 50 deg}}\n"
            f"sensor: {{{name}: \"${{'{one}' if drawn < 1 else '{another}'}}\"}}\n"
        )
        if load_scene(str(scene), seed=0).sensor[name] == first:
            break
    seed = next(s for s in range(60) if load_scene(str(scene), seed=s).sensor[name] == other)
    task = evis.env.Task(str(scene), evis.env.CountImage(), arguments={"width": 32, "height": 24, "upsampling": 4})
    env = evis.env.EventEnv(task)
    if name == "crossing":
        with pytest.raises(ValueError, match="crossing=cubic gives events one frame late"):
            env.reset(seed=seed)
        env.reset(seed=0)
    else:
        env.reset(seed=seed)
        seen = [env.step(np.zeros(1, np.float32))[0] for _ in range(3)]
        with evis.Simulation(str(scene), seed=seed, width=32, height=24, upsampling=4) as sim:
            sim.reset()
            for image in seen:
                assert image.sum() == len(sim.step([0.0]).events.t) > 0
    env.close()


def test_an_action_that_is_none_is_named_and_the_environment_goes_on() -> None:
    env = evis.env.EventEnv("CartPole", width=32, height=32)
    env.reset(seed=0)
    for action, message in (
        ([np.nan], "nan for actuator push"),
        ([1.5], "1.5 for actuator push of environment 0; it must be from -1 to 1"),
        ([0.0, 0.0], r"shape \[2\]; it must be \[1\]"),
        (0.0, r"shape \[\]; it must be \[1\]"),
        ([1j], r"1 real number\(s\), and not"),
        (["left"], r"1 real number\(s\), and not"),
    ):
        with pytest.raises(ValueError, match=message):
            env.step(np.array(action))
    for seed in (-1, 1.0, 2**63):
        with pytest.raises(ValueError, match="it takes whole numbers, 0 to"):
            env.reset(seed=seed)
    assert env.step(np.zeros(1))[1] > 0
    env.close()


def test_nothing_steps_before_it_has_begun() -> None:
    """One environment and several say what comes first."""
    alone, several = evis.env.EventEnv("CartPole"), evis.env.EventVectorEnv("CartPole", 2)
    for env, action in ((alone, np.zeros(1)), (several, np.zeros((2, 1)))):
        with pytest.raises(ValueError, match=r"nothing has begun; reset\(\) first"):
            env.step(action)
        env.close()


@pytest.mark.parametrize("missing", ["stable_baselines3", "torch"])
def test_without_stable_baselines_its_import_says_what_to_install(
    missing: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == "stable_baselines3"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, "evis.env.stable_baselines", raising=False)
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(ModuleNotFoundError, match=r"Stable-Baselines3 and PyTorch: pip install 'evis\[rl\]'"):
        importlib.import_module("evis.env.stable_baselines")
