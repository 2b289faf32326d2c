"""Processes that stand still: for a while, and nothing is changed by it; for ever, and the run ends and says who."""

from __future__ import annotations

import contextlib
import time

import numpy as np
import psutil
import pytest
import tally
from launcher import Launcher
from recorded_runs import HOW, Stage, opened, process_of

from evis.cli.graph.attach import find_run

CAMPAIGN = "freeze (SIGSTOP)"
PAUSE_S = 3.0
"""Less than SILENCE_S of the supervisor, after which a process is taken for frozen for ever."""
LONG_S = 10.0
"""More than that: while all stand still nobody misses anybody, as on a laptop that sleeps."""


@contextlib.contextmanager
def frozen(*processes: psutil.Process):
    """Stop them one after the other, and let them go on in the end."""
    for process in processes:
        process.suspend()
    try:
        yield
    finally:
        for process in processes:
            with contextlib.suppress(psutil.NoSuchProcess):
                process.resume()


def started(stage: Stage, how: str) -> tuple[Launcher, dict[str, psutil.Process]]:
    """A run under way, and its processes."""
    launcher = stage.launch(how)
    return launcher, stage.under_way(launcher)


def judge(stage: Stage, launcher: Launcher) -> list[str]:
    """What is wrong with a run that should have noticed nothing."""
    code, _, err = launcher.end()
    found = opened(stage.bag)
    wrong = [] if code == 0 else [f"exit status {code}: {err}"]
    wrong += [] if not found.torn and found.messages == stage.reference else ["the bag is not the undisturbed one"]
    return wrong + stage.nothing_left(launcher)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("how", HOW)
def test_a_pause_of_any_process_changes_nothing(how: str, stage: Stage, table: tally.Table) -> None:
    """Of each by itself, of all but the launcher, and of all for longer than a silent process is waited for."""
    before = len(table.failures(CAMPAIGN))
    launcher, alive = started(stage, how)
    launcher.stop()
    rng = np.random.default_rng([tally.SEED, *how.encode()])
    each = rng.permutation(sorted(alive))[: tally.number(len(alive))]
    for name in [*map(str, each), "all but the launcher", "all"]:
        stage.bag.unlink(missing_ok=True)
        stage.clear()
        launcher, alive = started(stage, how)
        chosen = [alive[name]] if name in alive else [p for n, p in alive.items() if name == "all" or n != "launcher"]
        with frozen(*chosen):
            time.sleep(LONG_S if name == "all" else PAUSE_S)
        wrong = judge(stage, launcher)
        if wrong:
            table.fail(CAMPAIGN, f"{name}, {how}", "; ".join(wrong))
        else:
            table.count(CAMPAIGN, f"{name}, {how}", "byte-equal")
    assert table.failures(CAMPAIGN)[before:] == []


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("how", HOW)
def test_a_process_that_is_frozen_for_ever_is_named_and_the_run_ended(
    how: str, stage: Stage, table: tally.Table
) -> None:
    """The launcher ends by itself; what was recorded until then is a prefix, and whole unless it was the recorder."""
    before = len(table.failures(CAMPAIGN))
    launcher, alive = started(stage, how)
    recorder = process_of(find_run(None), "recorder")
    launcher.stop()
    nodes = sorted(set(alive) - {"launcher", "janitor", "visualizer"})
    for name in nodes[: tally.number(len(nodes))]:
        stage.bag.unlink(missing_ok=True)
        stage.clear()
        launcher, alive = started(stage, how)
        alive[name].suspend()
        code, _, err = launcher.end()
        found = opened(stage.bag)
        wrong = stage.nothing_left(launcher)
        last = err.splitlines()[-1] if err else ""
        wrong += [] if code == 1 and name in last and "no sign of life" in last else [f"exit status {code}: {err!r}"]
        wrong += [] if stage.is_prefix(found.messages) else ["what is recorded is no prefix"]
        wrong += [] if name == recorder or not found.torn else [f"torn: {found.torn}"]
        if wrong:
            table.fail(CAMPAIGN, f"{name} for ever, {how}", "; ".join(wrong))
        else:
            table.count(CAMPAIGN, f"{name} for ever, {how}", "named, run ended, a prefix")
    assert table.failures(CAMPAIGN)[before:] == []
