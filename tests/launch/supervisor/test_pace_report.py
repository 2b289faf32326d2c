"""A pace that was not kept is told in the summary, with what was reached and what to change."""

from __future__ import annotations

import pytest

from evis.runtime.plan import Plan
from evis.supervisor.report import as_table, summarise


def summary(mode: str, pace: dict[str, float]) -> tuple[dict, str]:
    """Of a run of two nodes whose source was paced."""
    nodes = {
        "source": {"stamp_ns": 10**9, "first_stamp_ns": 0, "busy_s": 0.1, "results": {"pace": pace}},
        "sensor": {"stamp_ns": 10**9, "first_stamp_ns": 0, "busy_s": 3.0},
    }
    plan = Plan("disk", "run-1", "/nowhere", mode=mode)
    report = summarise(plan, [{"nodes": nodes}], startup_s=1.0, wall_s=4.0, failure=None, interrupted=False)
    return report.summary, as_table(report)


@pytest.mark.parametrize(
    ("mode", "wanted", "speed", "remedy"),
    [
        ("realtime", 1.0, "real-time factor 0.25,", "keyframe_rate, upsampling"),
        ("lockstep", 2.0, "real-time factor 0.25 in place of 2,", "a lower pace, as pace:=0.5"),
    ],
)
def test_a_pace_that_was_not_kept_is_one_line(mode: str, wanted: float, speed: str, remedy: str) -> None:
    found, table = summary(mode, {"wanted": wanted, "reached": 0.25, "late_ms_max": 3000})
    (line,) = [line for line in table.splitlines() if line.startswith("pace not kept: ")]
    assert speed in line and "up to 3,000 ms late" in line and "sensor took longest" in line and remedy in line
    assert found["pace"]["not_kept"] in line and found["pace"]["reached"] == 0.25


def test_a_pace_that_was_kept_is_told_in_numbers_alone() -> None:
    """The jitter of a busy machine is no failure; at a high speed it is as much more of the recording."""
    kept, table = summary("realtime", {"wanted": 1.0, "reached": 0.99, "late_ms_max": 40})
    assert "not_kept" not in kept["pace"] and "pace" not in table
    assert "not_kept" in summary("lockstep", {"wanted": 10.0, "reached": 9.0, "late_ms_max": 40})[0]["pace"]
