"""kill -9 of any process of a recorded run at any moment: nothing is left, and nothing that is recorded is wrong.

`pytest -m slow tests/adversary/test_kill_campaign.py`: 100 kills, each drawn from its number and EVIS_ADVERSARY_SEED.
"""

from __future__ import annotations

import contextlib
import signal
import time

import numpy as np
import pytest
import tally
from launcher import Launcher
from recorded_runs import (
    CHUNK_S,
    DURATION_S,
    HOW,
    TOPIC,
    Stage,
    Watcher,
    kill,
    named_shared_memory,
    opened,
    process_of,
    running_processes,
)

from evis.cli.graph.attach import find_run

CAMPAIGN = "kill -9"
PARTS = 0.4, 0.3, 0.3
"""As processes, composed, split."""
START = 0.25
"""Part of the kills that come while the processes start; the others come at a moment of the simulated time."""
LATE_S = 1.0
"""A recorder that dies takes a chunk with it, 100 ms; on a machine that others load its chunk is written late."""


def aftermath(stage: Stage, launcher: Launcher, victim: str, recorder: str, seen_ns: int) -> tuple[list[str], str, int]:
    """What is wrong after the kill, what it came to, and what is lost of what a viewer had seen [ns]."""
    code, _, err = launcher.end()
    wrong = stage.nothing_left(launcher)
    if not stage.bag.exists():
        return [*wrong, *(["no bag, though events were seen"] if seen_ns >= 0 else [])], "before the bag", 0
    found = opened(stage.bag)
    if not stage.is_prefix(found.messages):
        wrong.append(f"its {len(found.messages)} messages are no prefix of the undisturbed run")
    whole = len(found.messages) == len(stage.reference)
    last = found.messages[-1][0] if found.messages else -1
    lost_ns = max(0, seen_ns - last)
    if victim == "launcher":
        wrong += [] if code == -signal.SIGKILL or whole else [f"exit status {code}"]
    elif code == 0:
        wrong += [] if whole and not found.torn else [f"exit status 0 with {len(found.messages)} messages {found.torn}"]
    elif code != 1 or f"{victim} " not in err.splitlines()[-1] or "SIGKILL" not in err.splitlines()[-1]:
        wrong.append(f"exit status {code}, and not the name of {victim}: {err!r}")
    if victim not in ("launcher", recorder):
        # A graph that has not begun has nothing to lose: its recorder may be ended by force too.
        begun = bool(found.messages) or seen_ns >= 0
        wrong += [f"torn though its recorder was not killed: {found.torn}"] if found.torn and begun else []
        wrong += [f"{lost_ns / 1e6:.0f} ms lost"] if lost_ns > CHUNK_S * 1e9 else []
    elif lost_ns > LATE_S * 1e9:
        wrong.append(f"{lost_ns / 1e6:.0f} ms lost")
    state = "all events" if whole else f"a prefix, {'torn and recovered' if found.torn else 'whole bag'}"
    return wrong, state if found.messages or whole else "before the first event", lost_ns


def attack(stage: Stage, how: str, rng: np.random.Generator, table: tally.Table, trial: int) -> None:
    """One run, and one kill."""
    launcher, watcher, recorder = stage.launch(how), Watcher(), "recorder"
    try:
        launcher.wait_for(launcher.children)
        moment = rng.random()
        if moment < START:
            time.sleep(moment / START * (stage.wall_s[how] - DURATION_S))
        else:
            until_ns = (moment - START) / (1 - START) * DURATION_S * 1e9
            launcher.wait_for(lambda: watcher.newest >= until_ns or launcher.process.poll() is not None)
        with contextlib.suppress(ValueError):
            recorder = process_of(find_run(None), "recorder")
        alive = running_processes(launcher)
        victim = sorted(alive)[int(rng.integers(len(alive)))]
        mapped = [line for process in alive.values() for line in named_shared_memory(process)]
        seen_ns = watcher.newest
        kill(alive, victim)
        wrong, outcome, lost_ns = aftermath(stage, launcher, victim, recorder, seen_ns)
    finally:
        watcher.stop()
    row = f"{'recorder' if victim == recorder else victim}, {how}"
    table.most(CAMPAIGN, row, "most lost of what a viewer had seen [ms]", lost_ns / 1e6)
    if wrong or mapped:
        table.fail(CAMPAIGN, row, f"trial {trial}, {seen_ns / 1e9:.2f} s into {TOPIC}: {'; '.join(wrong + mapped)}")
    else:
        table.count(CAMPAIGN, row, outcome)


@pytest.mark.slow
@pytest.mark.timeout(7200)
def test_kill_9_of_any_process_at_any_moment(stage: Stage, table: tally.Table) -> None:
    """Each run finds the runtime directory, and every other one the bag, as the one before has left them."""
    for how in HOW:
        assert stage.undisturbed(how).messages == stage.reference
    for trial in range(tally.number(100)):
        rng = np.random.default_rng([tally.SEED, trial])
        stage.clear()
        if trial % 2:
            stage.bag.unlink(missing_ok=True)
        attack(stage, str(rng.choice(list(HOW), p=PARTS)), rng, table, trial)
    assert table.failures(CAMPAIGN) == []
    assert stage.undisturbed("as processes").messages == stage.reference, "and the next run is as the first"
