"""Stable-Baselines3's own check, and its PPO on environments of one simulation."""

import csv
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import evis.env

pytest.importorskip("stable_baselines3", reason="Stable-Baselines3 is not installed: make test-extras")
pytestmark = pytest.mark.extras


def test_stable_baselines_has_nothing_to_object() -> None:
    from stable_baselines3.common.env_checker import check_env

    for name in evis.env.TASKS:
        env = gymnasium.make(f"evis/{name}-v0", width=32, height=32).unwrapped
        check_env(env, skip_render_check=True)
        env.close()


def test_steps_are_passed_on() -> None:
    from evis.env.stable_baselines import StableBaselinesEnv

    def made(mode: str) -> evis.env.EventVectorEnv:
        return gymnasium.make_vec("evis/CartPole-v0", num_envs=2, autoreset_mode=mode, width=32, height=32, seconds=0.1)

    with pytest.raises(ValueError, match="SameStep"):
        StableBaselinesEnv(made("NextStep"))
    env, same = StableBaselinesEnv(made("SameStep")), made("SameStep")
    env.seed(4)
    assert (env.reset() == same.reset(seed=4)[0]).all()
    for step in range(5):
        action = np.full((2, 1), 0.1 * step, np.float32)
        got, want = env.step(action), same.step(action)
        assert (got[0] == want[0]).all() and (got[1] == want[1].astype(np.float32)).all()
        assert (got[2] == (want[2] | want[3])).all()
    assert got[2].all() and got[3][0]["TimeLimit.truncated"]
    assert (got[3][1]["terminal_observation"] == want[4]["final_obs"][1]).all()
    env.close()
    same.close()


def test_ppo_learns_from_it() -> None:
    from stable_baselines3 import PPO

    from evis.env.stable_baselines import StableBaselinesEnv

    observation = evis.env.CountImage(pool=8)
    env = gymnasium.make_vec(
        "evis/CartPole-v0", num_envs=2, autoreset_mode="SameStep", observation=observation, width=32, height=32
    )
    model = PPO("MlpPolicy", StableBaselinesEnv(env), n_steps=16, batch_size=16, n_epochs=1, device="cpu")
    before = [p.clone() for p in model.policy.parameters()]
    model.learn(64)
    assert any((a != b).any() for a, b in zip(before, model.policy.parameters()))
    env.close()


@pytest.fixture
def train(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "examples" / "tasks"))
    import train

    yield train
    for name in ("train", "observed"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize("arguments", ["--minutes 0", "--minutes -1", "--minutes nan", "--envs 0", "--seed -1"])
def test_a_training_that_cannot_be_is_refused(
    arguments: str, train, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setattr(sys, "argv", ["train.py", "CartPole", "--out", str(tmp_path / "t"), *arguments.split()])
    with pytest.raises(SystemExit):
        train.main()
    assert f"{arguments.split()[0]} is {arguments.split()[1]}; it must be" in capsys.readouterr().err
    assert not (tmp_path / "t").exists()


def test_a_training_shorter_than_a_rollout_has_an_empty_curve(train, tmp_path: Path) -> None:
    """Not that of the training before, which the folder holds; it can be drawn."""
    (tmp_path / "curve.csv").write_text("seconds,steps,return,length\n5,2048,400,450\n")
    train.train("CartPole", minutes=1e-4, count=2, seed=0, out=tmp_path)
    assert (tmp_path / "curve.csv").read_text().split() == ["seconds,steps,return,length"]
    train.draw({"CartPole": tmp_path / "curve.csv"}, tmp_path / "curve.png")
    assert (tmp_path / "curve.png").stat().st_size > 1000


@pytest.mark.slow
def test_a_short_training_of_the_examples_improves(train, tmp_path: Path) -> None:
    """Half a minute of the head that follows a ball; doing nothing gives 2.4, and chance 4.8."""
    train.train("PanTilt", minutes=0.5, count=16, seed=0, out=tmp_path)
    with (tmp_path / "curve.csv").open() as file:
        returns = [float(row["return"]) for row in csv.DictReader(file)]
    assert returns[-1] > 1.8 * returns[0], returns
    assert train.score("PanTilt", tmp_path, episodes=4, seed=500)[:, 0].mean() > 4.8
