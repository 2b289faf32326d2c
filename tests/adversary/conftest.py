"""What the campaigns share: helpers of other rooms, a place to run in, and the table of what came of the attacks."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path[:0] = [str(Path(__file__).parents[1] / room) for room in ("bag", "launch", "events")]

import tally  # noqa: E402
from recorded_runs import Stage  # noqa: E402


@pytest.fixture(scope="session")
def table() -> tally.Table:
    """Where every campaign counts its attacks."""
    return tally.TABLE


@pytest.fixture(scope="session")
def reference(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[int, bytes]]:
    """Events of the run that all campaigns disturb, undisturbed."""
    with Stage.made(tmp_path_factory.mktemp("reference")) as stage:
        return stage.undisturbed("as processes").messages


@pytest.fixture
def stage(tmp_path: Path, reference: list[tuple[int, bytes]]) -> Iterator[Stage]:
    """Where a campaign runs, alone."""
    with Stage.made(tmp_path) as stage:
        stage.reference = reference
        yield stage


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the table below the results."""
    if tally.TABLE.rows:
        terminalreporter.section("attacks")
        terminalreporter.write(tally.TABLE.markdown())
