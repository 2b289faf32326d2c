"""Environments that share threads: the bytes are those of each alone, whatever their number and whatever goes wrong."""

from pathlib import Path

import numpy as np
import pytest
from environments_rig import controls, engine_of, told

from evis.runtime.workers import Workers
from nodes.physics.dynamics.batch.mujoco_threads import MujocoThreads
from nodes.physics.dynamics.course import paths
from nodes.physics.environments.environments import Environments


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4", "discrete"])
@pytest.mark.parametrize("gap_ns", [33_333_333, 400_000])
def test_each_moves_as_alone(tmp_path: Path, integrator: str, gap_ns: int) -> None:
    """On one thread and on three, with actions of its own; stamps beside the grid, and closer than its steps."""
    option = f"integrator='{integrator}'"
    alone = [engine_of(tmp_path, 1, seed=3 + k, option=option) for k in range(5)]
    shared = [engine_of(tmp_path, 5, threads, option=option) for threads in (1, 3)]
    for n in range(1, 13):
        action = controls(n, 5)
        expected = [told(engine.advance(n * gap_ns, action[k : k + 1]), 0) for k, engine in enumerate(alone)]
        for engine in shared:
            interval = engine.advance(n * gap_ns, action)
            assert [told(interval, k) for k in range(5)] == expected


def test_what_goes_wrong_in_one_is_told_of_it(tmp_path: Path) -> None:
    """A velocity that is not finite in one, an overlap in another: same words, and the others go on."""
    shared, alone = engine_of(tmp_path, 3, 2), [engine_of(tmp_path, 1, seed=3 + k) for k in range(3)]
    said = []
    for n in range(1, 31):
        if n == 4:
            for data in (shared.data[1], alone[1].data[0]):
                data.qvel[6] = np.nan
            for data in (shared.data[2], alone[2].data[0]):
                data.qpos[2] = -0.05
        interval = shared.advance(n * 10_000_000)
        said += interval.faults + interval.warnings
        expected = [told(engine.advance(n * 10_000_000), 0) for engine in alone]
        assert [told(interval, k) for k in range(3)] == expected
    assert [env for env, text in said if "'cart' diverged" in text] == [1]
    assert any(env == 2 and "overlap" in text for env, text in said)


def test_resets_of_single_ones_share_the_threads(tmp_path: Path) -> None:
    """Environments in times of their own, reset one by one: the same bytes on one thread and on two."""
    runs = []
    for threads in (1, 2):
        worlds = Environments(engine_of(tmp_path, 4, threads), 4, 30.0)
        worlds.advance(0)
        found = []
        for k in range(1, 16):
            if k in (3, 5, 6, 11):
                worlds.restart([k % 4], [-1 if k % 2 else 17], [1], k - 1)
                worlds.present()
            interval = worlds.advance(k, controls(k, 4))
            found.append([told(interval, env) for env in range(4)])
        runs.append(found)
    assert runs[0] == runs[1]


def test_those_reset_by_themselves_move_as_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Several begin anew at keyframes of their own, so that each is one of many in what MuJoCo's threads recorded:
    written from there by no thread beside the caller's."""
    # 50 Hz: stamps since any reset are whole steps from one another.
    worlds = Environments(engine_of(tmp_path, 4, 2, contacts=False), 4, 50.0)
    worlds.advance(0)
    begun = {3: 1, 5: 2, 6: 0, 9: 2}
    first = dict.fromkeys(range(4), 0)
    for k in range(1, 15):
        if k in begun:
            worlds.restart([begun[k]], [40 + k], [0], k - 1)
            worlds.present()
            first[begun[k]] = k - 1
        if k == 10:
            monkeypatch.setattr(Workers, "submit", _no_thread)
        last = worlds.advance(k, np.zeros((4, 1)))
    monkeypatch.undo()
    seeds = {1: 43, 2: 49, 0: 46, 3: 6}
    for env, seed in seeds.items():
        alone, n = engine_of(tmp_path, 1, seed=seed, contacts=False), 14 - first[env]
        for k in range(1, n + 1):
            interval = alone.advance(20_000_000 * k, np.zeros((1, 1)))
        assert told(last, env) == told(interval, 0)


@pytest.mark.parametrize("order", [[0, 1, 2], [2, 0, 1], [2, 0]])
def test_environments_begin_anew_in_any_order(tmp_path: Path, order: list[int]) -> None:
    """Each of those that share a batch gets its own states back, joints too, wherever it stands there."""
    engine = engine_of(tmp_path, 3, 1, contacts=False)
    engine.advance(20_000_000)
    anew = engine.anew(order, [10 + env for env in order], [0] * len(order))
    alone = [engine_of(tmp_path, 1, seed=10 + env, contacts=False) for env in order]
    for k in range(1, 4):
        pushes = np.arange(len(order), dtype=float)[:, None]
        interval = anew.advance(k * 20_000_000, pushes)
        for n, own in enumerate(alone):
            assert told(interval, n) == told(own.advance(k * 20_000_000, pushes[n : n + 1]), 0)


def _no_thread(*_given: object) -> None:
    raise AssertionError("to hand over one environment takes longer than to do it")


@pytest.mark.parametrize("contacts", [False, True])
@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
@pytest.mark.parametrize("many", [False, True])
def test_what_is_begun_ahead_changes_nothing(
    tmp_path: Path, integrator: str, contacts: bool, many: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The next steps are taken while others work; then an action comes, an environment is reset, another diverges.

    Of many environments they begin before the states after the last ones are written, so of a few that count as many.
    """
    if many:
        monkeypatch.setattr(paths, "SMALL", 0)
    early = []
    begin = MujocoThreads.begin
    monkeypatch.setattr(MujocoThreads, "begin", lambda self, keep=False: (early.append(keep), begin(self, keep)))
    runs = []
    for ahead in (False, True):
        engine = engine_of(tmp_path, 5, 2, contacts=contacts, option=f"integrator='{integrator}'")
        worlds = Environments(engine, 5, 30.0)
        worlds.advance(0)
        found = []
        for k in range(1, 18):
            if k in (4, 6, 7, 12):
                worlds.restart([k % 5], [-1 if k % 2 else 17], [1], k - 1)
                worlds.present()
            if k == 9:
                (first, *_others) = worlds._groups
                first.engine.data[0].qvel[6] = np.nan
            interval = worlds.advance(k, controls(k, 5) if k in (3, 4, 10, 13) else None, ahead and k != 8)
            found.append([told(interval, env) for env in range(5)])
        runs.append(found)
    assert runs[0] == runs[1]
    assert any(faults for each in runs[0] for _arrays, _touched, (faults, _warnings) in each)
    assert any(early) == (many and not contacts)


def test_an_action_is_not_too_late_for_what_was_begun(tmp_path: Path) -> None:
    """Steps that were begun without it are taken again."""
    plain, ahead = engine_of(tmp_path, 3, 2), engine_of(tmp_path, 3, 2)
    for n in range(1, 6):
        ahead.foresee(n * 20_000_000)
        ahead.begin()
        action = controls(n, 3)
        expected, found = (engine.advance(n * 20_000_000, action) for engine in (plain, ahead))
        assert [told(found, k) for k in range(3)] == [told(expected, k) for k in range(3)]


def test_those_that_go_wrong_while_the_next_steps_are_under_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of many: their steps are taken back, and taken anew after what a check of each state has told; all others go
    on."""
    monkeypatch.setattr(paths, "SMALL", 0)
    plain, ahead = (engine_of(tmp_path, 4, 2, contacts=False) for _ in range(2))
    # They reach 1000 m/s, the limit, after some gaps.
    pushed = np.array([[0.0], [1e5], [1e4], [2e4]])
    told_of, taken_back = [], []
    for n in range(1, 31):
        action = pushed if n == 3 else 0 * pushed if n == 20 else None
        expected = plain.advance(n * 10_000_000, action)
        found = ahead.advance(n * 10_000_000, action, then_ns=(n + 1) * 10_000_000)
        assert [told(found, k) for k in range(4)] == [told(expected, k) for k in range(4)], n
        told_of += [env for env, _text in found.faults]
        taken_back.append(ahead._lacking)
    assert sorted({*told_of}) == [1, 2, 3]
    assert sum(taken_back) >= 3
