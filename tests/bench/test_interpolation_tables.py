"""Tables of the interpolation benchmark, on runs whose errors and events are made up."""

import numpy as np

from bench.interpolation.auto import Fixed, Wish, ratios, wishes_of
from bench.interpolation.pipeline import Run
from bench.interpolation.tables import Row, by_method, failures
from evis.events.measure.distance import EventStream


def row(method, rate, k, error, events, frame_error=0.1):
    none = np.zeros(events, np.int64)
    run = Run({"linear": EventStream(none, none, none, none, 4, 4)}, {"linear": 1.0}, frame_errors=[frame_error])
    return Row(method, rate, k, 0.0, "linear", run, {"VP 1/ms": error})


ROWS = [
    row("none", 1000, 1, 0.1, 100),
    row("none", 250, 1, 0.4, 90),
    row("splat", 250, 4, 0.7, 750),
    row("splat", 125, 8, 0.15, 130),
    row("rigid", 31.25, 32, 0.15, 101, frame_error=1.5),
    row("rigid", 31.25, 8, 0.5, 95),
]


def test_runs_that_fail_are_those_far_above_dense_rendering():
    """By error or by their frames; of 1000 frames per second only; dense rendering is the measure and no failure."""
    found = [(r["method"], r["keyframes x K"], r["error over dense 1000x1"], r["events over dense 1000x1"])
             for r in failures("scene", ROWS)]  # fmt: skip
    assert found == [("splat", "250x4", 7.0, 7.5), ("rigid", "31.25x32", 1.5, 1.01)]


def test_every_method_has_a_line_with_its_runs_and_cases():
    runs = [*failures("disk", ROWS), *failures("drone", ROWS[:3])]
    cases = [
        {"case": "shadow", "off": {"splat": 0.5, "rigid": 0.021}},
        {"case": "sky", "off": {"splat": 0.02, "forward": 0.0}},
    ]
    lines = {line["method"]: (line["fails on"], line["fails in"]) for line in by_method(runs, cases)}
    assert lines == {
        "splat": ("disk at 250x4; drone at 250x4", "shadow (50 %)"),
        "rigid": ("disk at 31.25x32", "shadow (2 %)"),
        "forward": ("no scene", "no hard case"),
    }


FIXED = (Fixed("slow", 4.0, 0.1), Fixed("fast", 1.0, 0.4), Fixed("middle", 2.0, 0.2), Fixed("bad", 3.0, 0.8))


def test_auto_is_asked_for_quarters_of_what_there_is():
    """In order the times are 1, 2, 3, 4 and the errors 0.1, 0.2, 0.4, 0.8."""
    assert [(wish.kind, wish.wanted) for wish in wishes_of(FIXED)] == [
        ("rule", 0.0), ("time", 2.0), ("time", 3.0), ("time", 4.0), ("error", 0.2), ("error", 0.4)
    ]  # fmt: skip


def test_auto_beside_the_best_choice_at_its_time_at_that_wanted_and_at_its_error():
    """Worked by hand: it took 2.5 s for an error of 0.3, in whose time `middle` had 0.2."""
    own = Fixed("own", 2.5, 0.3)
    beside = {"best fixed": "middle (0.2000, 2.00 s/s)", "error ratio": 1.5}
    nothing = {"error ratio, wanted time": "", "time ratio": ""}
    assert ratios(Wish("rule"), own, FIXED) == beside | nothing
    assert ratios(Wish("time", 4.0), own, FIXED) == beside | nothing | {"error ratio, wanted time": 3.0}
    assert ratios(Wish("time", 0.5), own, FIXED) == beside | nothing | {"error ratio, wanted time": 1.0}
    assert ratios(Wish("error", 0.4), own, FIXED) == beside | nothing | {"time ratio": 2.5}
    assert ratios(Wish("error", 0.1), own, FIXED) == beside | nothing | {"time ratio": 1.25}
