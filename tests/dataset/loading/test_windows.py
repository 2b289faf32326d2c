"""Windows against what they are: all events once, labels of their end, the representation of these events."""

from __future__ import annotations

import pickle
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_set import HEIGHT, PERIOD_NS, WIDTH, same

import evis
from evis.dataset.errors import DatasetError
from evis.dataset.loading.order import order, share
from evis.dataset.loading.picking import at_end, at_start
from evis.events.representations import count_image, event_stack, time_surface, voxel_grid

Made = tuple[Path, Path]


def test_a_data_set_by_number_and_by_split(small: Made) -> None:
    """What a sequence says of itself is what made it: another simulation of that gives its events."""
    data = evis.dataset.open(small[1])
    assert len(data) == 3 and sum(data.splits.values()) == 3 and data.splits["train"] == 2
    assert [s.name for s in data.split("train")] == [s.name for s in data if s.split == "train"]
    assert [s.index for s in data[1:]] == [1, 2]
    sequence = data[2]
    assert sequence.cameras["cam0"].width == WIDTH and sequence.duration_ns == 200_000_000
    with evis.Simulation(sequence.scene, seed=sequence.seed, **sequence.arguments) as sim:
        packets = [step.events for step in [sim.reset(), *sim.run(0.2), sim.finish()] if step.events is not None]
    events = sequence.events()
    for name in "txyp":
        assert np.array_equal(getattr(events, name), np.concatenate([getattr(p, name) for p in packets]))
    assert sequence.count() == len(events.t) and 15 < sequence.arguments["omega"] < 70


def test_windows_by_time_have_every_event_once(small: Made) -> None:
    """Without a stride they follow each other; borders are rounded as the stamps of keyframes are."""
    data = evis.dataset.open(small[1])
    windows = data.windows(seconds=1 / 30)
    assert len(windows) == 3 * 6 and not any(windows.left_out.values())
    for sequence in data:
        own = [w for w in windows if w["sequence"] == sequence.index]
        assert [(w["t0_ns"], w["t1_ns"]) for w in own] == [
            (round(k * PERIOD_NS), round((k + 1) * PERIOD_NS)) for k in range(6)
        ]
        truth = sequence.events(0, sequence.duration_ns)
        for name in "txyp":
            assert np.array_equal(np.concatenate([w["events"][name] for w in own]), getattr(truth, name))


def test_windows_by_number_overlap_as_asked(small: Made) -> None:
    data = evis.dataset.open(small[1])
    windows = data.windows(events=500, stride=200)
    for sequence in data:
        t = sequence.events().t
        own = [w for w in windows if w["sequence"] == sequence.index]
        assert len(own) == (len(t) - 500) // 200 + 1
        for k, w in enumerate(own):
            assert np.array_equal(w["events"]["t"], t[200 * k : 200 * k + 500])
            assert (w["t0_ns"], w["t1_ns"]) == (t[200 * k], t[200 * k + 499] + 1)


def test_labels_are_those_of_the_end_of_the_window(small: Made) -> None:
    """Flow is that over the interval which ends with it, so over the window itself where that is as long."""
    data = evis.dataset.open(small[1])
    kinds = ["forward_flow", "boxes", "depth"]
    for w in data.windows(seconds=1 / 30, labels=kinds):
        sequence = data[w["sequence"]]
        assert w["flow_t"].tolist() == [w["t0_ns"], w["t1_ns"]]
        for kind in kinds:
            assert w[f"{kind}_ns"] == w["t1_ns"]
            truth = sequence.labels(kind, w["t1_ns"], w["t1_ns"] + 1)
            assert len(truth["t"]) == 1
            for name in truth.keys() - {"t", "offsets"}:
                same(w[name], truth[name] if kind == "boxes" else truth[name][0])
    every = data.windows(seconds=0.01, labels=["depth"])
    assert [w["depth_ns"] - w["t0_ns"] for w in every] == [
        round(k * PERIOD_NS) - (round(k * PERIOD_NS) - 1) // 10**7 * 10**7 for _ in range(3) for k in range(1, 7)
    ]
    assert len(every) + every.left_out["windows without a label"] == 3 * 20


def test_labels_of_events_are_rows_of_the_events(small: Made) -> None:
    data = evis.dataset.open(small[1])
    noise = 0
    for w in data.windows(seconds=0.05, labels=["events"]):
        truth = data[w["sequence"]].labels("events", w["t0_ns"], w["t1_ns"])
        assert np.array_equal(truth["t"], w["events"]["t"])
        for name in ("event_instance", "event_flow", "event_signal"):
            same(w[name], truth[name])
        noise += np.count_nonzero(w["event_signal"] == 0)
    assert noise > 100


def test_representations_are_those_of_evis_events(small: Made) -> None:
    data = evis.dataset.open(small[1])
    size = {"height": HEIGHT, "width": WIDTH}
    cases = {
        "voxel_grid": ({"bins": 5, "normalise": True}, lambda e, w: voxel_grid(e, 5, window=w, normalise=True, **size)),
        "count_image": ({}, lambda e, w: count_image(e, **size)),
        "event_stack": ({"bins": 3, "by": "count"}, lambda e, w: event_stack(e, 3, by="count", **size)),
        "time_surface": ({"tau_ns": 10**7}, lambda e, w: time_surface(e, 10**7, at=w[1], **size)),
    }
    for name, (options, function) in cases.items():
        raw = data.windows(seconds=0.05)[3]
        got = data.windows(seconds=0.05, representation=name, **options)[3]
        want = function(raw["events"], (raw["t0_ns"], raw["t1_ns"]))
        assert want.outside.tolist() == [0, 0] and want.values.any()
        same(got["events"], want.values)


def test_which_label_a_window_takes() -> None:
    """By looking at all of them: the last that ends in (t0, t1]; backwards the first that begins in [t0, t1)."""
    rng = np.random.default_rng(1)
    borders = np.cumsum(rng.integers(1, 30, 40)) * 1000
    stamps = np.stack((borders[:-1], borders[1:]), -1)
    t0 = rng.integers(0, 500, 300) * 1000
    t1 = t0 + rng.integers(1, 60, 300) * 1000
    for k in range(300):
        ends = [i for i, (_, end) in enumerate(stamps) if t0[k] < end <= t1[k]]
        begins = [i for i, (begin, _) in enumerate(stamps) if t0[k] <= begin < t1[k]]
        assert at_end(stamps, t0, t1)[k] == max(ends, default=-1)
        assert at_start(stamps, t0, t1)[k] == min(begins, default=-1)
    assert at_end(stamps[:0], t0, t1).max() == at_start(stamps[:0], t0, t1).max() == -1


def test_order_and_shares() -> None:
    """A permutation of seed and epoch; ranks and workers have all of it once, ranks equally many."""
    one = order(103, True, 5, 0)
    assert sorted(one) == list(range(103)) and not np.array_equal(one, order(103, True, 5, 1))
    assert np.array_equal(one, order(103, True, 5, 0)) and not np.array_equal(one, order(103, True, 6, 0))
    assert np.abs(np.corrcoef(one, np.arange(103))[0, 1]) < 0.3
    parts = [[share(one, r, 4, w, 3) for w in range(3)] for r in range(4)]
    assert [sum(map(len, rank)) for rank in parts] == [25] * 4
    everything = np.concatenate([part for rank in parts for part in rank])
    assert sorted(everything) == sorted(one[:100])


@pytest.mark.parametrize(
    ("how", "text"),
    [
        ({"rank": 2, "ranks": 2}, "rank is 2 of 2 ranks"),
        ({"rank": 1}, "rank is 1 of 1 ranks"),
        ({"rank": -1, "ranks": 2}, "rank is -1; it must be a whole number, 0 or more"),
        ({"ranks": 0}, "ranks is 0; it must be a whole number, 1 or more"),
        ({"rank": 0.5, "ranks": 2}, "rank is 0.5"),
        ({"epoch": 0.5}, "epoch is 0.5; it must be a whole number"),
    ],
)
def test_ranks_and_epochs_that_are_not_there(small: Made, how: dict[str, Any], text: str) -> None:
    windows = evis.dataset.open(small[1]).windows(seconds=0.1)
    with pytest.raises(DatasetError, match=re.escape(text)):
        next(windows.batches(2, **how))


def test_sequences_that_are_chosen_one_by_one(small: Made) -> None:
    """Their windows are those of the whole, in the order that was asked for."""
    data = evis.dataset.open(small[1])
    for numbers in ([2, 0], np.array([2, 0]), (n for n in (-1, 0))):
        assert [s.name for s in data[numbers]] == [data[2].name, data[0].name]
    whole, part = (chosen.windows(seconds=0.1, arguments=["omega"]) for chosen in (data, data[[2, 0]]))
    assert len(part) == 4
    for i, n in enumerate((4, 5, 0, 1)):
        same(part[i], whole[n])


def test_batches(small: Made) -> None:
    """Images stack; events and boxes are joined with offsets, as a batch of the representations."""
    data = evis.dataset.open(small[1])
    windows = data.windows(seconds=1 / 30, labels=["boxes", "forward_flow"], arguments=["omega"], seed=2)
    numbers = windows.order(True, 3)
    batches = list(windows.batches(4, shuffle=True, epoch=3))
    assert [len(b["window"]) for b in batches] == [4, 4, 4, 4, 2]
    windows.set_epoch(3)
    for told, asked in zip(windows.batches(4, shuffle=True), batches, strict=True):
        same(told, asked)
    batch, own = batches[1], [windows.sample(i, 3) for i in numbers[4:8]]
    assert batch["forward_flow"].shape == (4, HEIGHT, WIDTH, 2)
    assert batch["omega"].tolist() == [data[w["sequence"]].arguments["omega"] for w in own]
    for k, w in enumerate(own):
        rows = slice(*batch["events"]["env_offsets"][k : k + 2])
        assert np.array_equal(batch["events"]["t"][rows], w["events"]["t"])
        assert np.array_equal(batch["box"][slice(*batch["boxes_offsets"][k : k + 2])], w["box"])
    ends = np.stack((batch["t0_ns"], batch["t1_ns"]))
    grids = voxel_grid(batch["events"], 5, window=(ends[0], ends[1]), height=HEIGHT, width=WIDTH).values
    alone = data.windows(seconds=1 / 30, representation="voxel_grid", bins=5)
    assert np.array_equal(grids, np.stack([alone[int(i)]["events"] for i in numbers[4:8]]))
    assert len(list(windows.batches(4, whole=True))) == 4


def test_they_may_be_pickled(small: Made) -> None:
    windows = evis.dataset.open(small[1]).windows(seconds=0.05, representation="voxel_grid", bins=3, labels=["depth"])
    first = windows[0]
    same(pickle.loads(pickle.dumps(windows))[0], first)


@pytest.mark.parametrize("i", [1.5, slice(3), np.float64(2), "0"])
def test_a_window_is_taken_by_its_whole_number(small: Made, i: Any) -> None:
    """1.5 was the first window."""
    windows = evis.dataset.open(small[1]).windows(seconds=1 / 30)
    with pytest.raises(TypeError, match="by its whole number"):
        windows[i]
    same(windows[np.int64(1)], windows[1])


@pytest.mark.parametrize("i", [-19, 18])
def test_a_window_that_is_not_there(small: Made, i: int) -> None:
    with pytest.raises(IndexError, match=f"no window {i}; there are 18"):
        evis.dataset.open(small[1]).windows(seconds=1 / 30)[i]


def test_exposures_of_frames_are_joined() -> None:
    """A frame comes with a number of its own."""
    frame = np.zeros((2, 3, 1), np.uint8)
    batch = evis.dataset.collate([{"image": frame + k, "exposure_ns": np.int64(k)} for k in (4, 7)])
    assert batch["image"].shape == (2, 2, 3, 1)
    assert batch["exposure_ns"].dtype == np.int64 and batch["exposure_ns"].tolist() == [4, 7]


@pytest.mark.parametrize(
    ("samples", "says"),
    [
        ([], "no samples; a batch has at least one"),
        (None, "collate joins a list of samples, .* not None"),
        ({"depth": np.zeros(2)}, "collate joins a list of samples"),
        ([{"depth": np.zeros(2)}, {}], "sample 0 of a batch has 'depth' and sample 1 has not"),
        ([{}, {"depth": np.zeros(2)}], "sample 1 of a batch has 'depth' and sample 0 has not"),
        ([{"events": {"t": np.zeros(1)}}, {"events": np.zeros((2, 3, 4))}], "sample 0 of a batch has 'events.t'"),
    ],
)
def test_what_is_no_batch_is_refused(samples: Any, says: str) -> None:
    with pytest.raises(DatasetError, match=says):
        evis.dataset.collate(samples)


def test_numbers_alone_are_a_batch() -> None:
    batch = evis.dataset.collate([{"window": 3}, {"window": 5}])
    assert batch["window"].dtype == np.int64 and batch["window"].tolist() == [3, 5]


def test_arguments_that_are_text(small: Made) -> None:
    """They come as they are, for PyTorch has no tensors of them."""
    data = evis.dataset.open(small[1])
    for sequence, preset in zip(data, ("ideal", "davis346", "ideal")):
        sequence.arguments["preset"] = preset
    windows = data.windows(seconds=0.2, arguments=["preset", "width"])
    batch = next(windows.batches(3))
    assert batch["preset"] == ["ideal", "davis346", "ideal"] and isinstance(windows[1]["preset"], str)
    assert batch["width"].tolist() == [WIDTH] * 3
