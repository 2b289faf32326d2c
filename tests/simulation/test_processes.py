"""Simulations and environments in other processes: one that is taken along is refused in one line, in a fork too."""

from __future__ import annotations

import gc
import multiprocessing
from collections.abc import Callable
from typing import Any

import pytest

import evis

pytest.importorskip("gymnasium")
import gymnasium

import evis.env

SIZE = {"width": 32, "height": 24}
SECONDS = 100
"""Against hangs only: a fork waited for threads that it does not have."""


def answer(pipe: Any, work: Callable[[Any], Any], taken: Any) -> None:
    """In the other process: sends what `work` gives, or the error."""
    try:
        pipe.send((None, work(taken)))
    except Exception as error:
        pipe.send((f"{type(error).__name__}: {error}", None))


def elsewhere(start: str, work: Callable[[Any], Any], taken: Any) -> tuple[str | None, Any]:
    """What becomes of work in another process: the error or None, and the result."""
    context = multiprocessing.get_context(start)
    here, there = context.Pipe()
    process = context.Process(target=answer, args=(there, work, taken), daemon=True)
    process.start()
    try:
        assert here.poll(SECONDS), "no answer"
        return here.recv()
    finally:
        process.kill()
        process.join()


def stepped(sim: evis.Simulation) -> int:
    return len(sim.step().events.t)


def reset(taken: Any) -> Any:
    return taken.reset(seed=1)


def left(sim: evis.Simulation) -> str:
    with sim:
        pass
    return "left"


def made_there(_: Any) -> bytes:
    with evis.Simulation("cart_pole", envs=4, threads=2, **SIZE) as sim:
        sim.reset(seed=1)
        return sim.step().events.t.tobytes()


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")
@pytest.mark.parametrize(
    "arguments",
    [{"envs": 4, "threads": 2}, {"envs": 1}, {"envs": 2, "threads": 2, "time_tolerance": 1e-3}],
    ids=str,
)
def test_a_forked_simulation_is_refused_and_its_own_process_goes_on(arguments: dict[str, Any]) -> None:
    """With threads it waited for them for ever; whether it has some is nothing that a user can know."""
    with evis.Simulation("cart_pole", **arguments, **SIZE) as undisturbed:
        undisturbed.reset(seed=1)
        expected = [undisturbed.step().events.t.tobytes() for _ in range(2)]
    with evis.Simulation("cart_pole", **arguments, **SIZE) as sim:
        sim.reset(seed=1)
        steps = [sim.step().events.t.tobytes()]
        for work in (stepped, reset):
            told, _ = elsewhere("fork", work, sim)
            assert told is not None and told.startswith(
                "SimulationError: a simulation cannot go on in a process that was"
            )
        assert elsewhere("fork", left, sim) == (None, "left")
        steps.append(sim.step().events.t.tobytes())
    assert steps == expected


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")
@pytest.mark.parametrize("envs", [1, 3])
def test_a_forked_environment_is_refused(envs: int) -> None:
    made: Any = (
        gymnasium.make_vec("evis/CartPole-v0", num_envs=envs) if envs > 1 else gymnasium.make("evis/CartPole-v0")
    )
    made.reset(seed=1)
    told, _ = elsewhere("fork", reset, made)
    assert told is not None and "a simulation cannot go on in a process that was forked" in told
    made.reset(seed=1)
    made.close()


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")
@pytest.mark.parametrize("start", ["fork", "spawn"])
def test_one_that_is_made_there_has_the_same_bytes(start: str) -> None:
    """Also where the process that forks has simulated before."""
    assert elsewhere(start, made_there, None) == (None, made_there(None))


def collected(_: Any) -> str:
    gc.collect()
    return "collected"


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")
def test_a_fork_collects_what_its_parent_has_left() -> None:
    """Of threads that MuJoCo would wait for before it frees a simulation that was closed, and of one that was not."""
    gc.disable()
    try:
        for closed in (True, False):
            sim = evis.Simulation("cart_pole", envs=4, threads=2, **SIZE)
            sim.reset(seed=1)
            sim.step()
            if closed:
                sim.close()
            sim.cycle = sim  # type: ignore[attr-defined]
            del sim
        assert elsewhere("fork", collected, None) == (None, "collected")
    finally:
        gc.enable()


def test_one_that_is_sent_is_refused() -> None:
    with (
        evis.Simulation("cart_pole", **SIZE) as sim,
        pytest.raises(
            evis.SimulationError, match="a simulation cannot be copied or pickled; make one where it is needed"
        ),
    ):
        elsewhere("spawn", stepped, sim)
