"""The same seed gives the same bytes: however the graph is cut into processes, whoever looks on, whatever else runs."""

from __future__ import annotations

import contextlib
import multiprocessing
import time
from collections.abc import Iterator

import pytest
import tally
from recorded_runs import HOW, Stage, Watcher, opened

CAMPAIGN = "determinism"
LOADED_S = 60.0
"""The load ends by itself after this time, whatever becomes of the test."""


def _burn(until: float) -> None:
    while time.monotonic() < until:
        pass


@contextlib.contextmanager
def load(processes: int = 3) -> Iterator[None]:
    """Others want the cores as well."""
    spawn = multiprocessing.get_context("spawn")
    burning = [spawn.Process(target=_burn, args=(time.monotonic() + LOADED_S,), daemon=True) for _ in range(processes)]
    for process in burning:
        process.start()
    try:
        yield
    finally:
        for process in burning:
            process.kill()
            process.join()


@contextlib.contextmanager
def viewer() -> Iterator[None]:
    """Somebody looks at the events."""
    watcher = Watcher()
    try:
        yield
        assert watcher.newest >= 0, "it saw nothing"
    finally:
        watcher.stop()


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("how", HOW)
def test_one_seed_one_hash(how: str, stage: Stage, table: tally.Table) -> None:
    around = {"alone": contextlib.nullcontext, "with a viewer": viewer, "under load": load}
    for _ in range(tally.number(2)):
        for pace in "fast", "realtime":
            for name, context in around.items():
                stage.clear()
                with context():
                    found = stage.undisturbed(how, pace)
                if found.torn or found.messages != stage.reference:
                    table.fail(CAMPAIGN, f"{how}, {name}", f"{pace}: {len(found.messages)} messages {found.torn}")
                else:
                    table.count(CAMPAIGN, f"{how}, {name}", "one hash")
    assert table.failures(CAMPAIGN) == []


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("how", HOW)
def test_events_made_anew_from_a_bag_are_the_recorded_ones(how: str, stage: Stage, table: tally.Table) -> None:
    """`replay regenerate:=true` of a bag with keyframes."""
    stage.undisturbed("as processes", "fast", "--record-topics", "/cam0/keyframe,/cam0/depth,/cam0/ids,/cam0/motion")
    source = stage.folder / "keyframes.mcap"
    stage.bag.rename(source)
    assert opened(source).messages == stage.reference
    for _ in range(tally.number(2)):
        stage.clear()
        code, _, err = stage.start("replay", f"bag:={source}", "regenerate:=true", how=how).end()
        assert code == 0, err
        if opened(stage.bag).messages == stage.reference:
            table.count(CAMPAIGN, f"{how}, made anew from keyframes", "one hash")
        else:
            table.fail(CAMPAIGN, f"{how}, made anew from keyframes", "other events")
    assert table.failures(CAMPAIGN) == []
