"""What is simulated while it is used is what the data set on the disk gives, to the byte."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_set import RECIPE, made, same

import evis
from evis.dataset import Augment
from evis.dataset.making import warm
from evis.dataset.recipe_file import read_recipe

Made = tuple[Path, Path]
EVERYTHING = Augment(flip_x=0.5, flip_y=0.5, reverse=0.5, crop=(20, 24), drop=0.1, noise=10.0)
LABELS = ["forward_flow", "boxes", "depth"]


@pytest.mark.parametrize(
    "how",
    [
        {"seconds": 1 / 30, "representation": "voxel_grid", "bins": 5, "labels": LABELS, "arguments": ["omega"]},
        {"seconds": 0.05, "stride": 0.02, "labels": ["depth", "events"]},
        {"events": 700, "stride": 300, "labels": ["depth"]},
        {"events": 1000, "representation": "count_image"},
        {"seconds": 0.07, "stride": 0.03, "labels": LABELS, "augment": EVERYTHING, "seed": 5},
    ],
    ids=lambda how: "-".join(map(str, how)),
)
def test_a_stream_gives_what_the_data_set_gives(small: Made, how: dict[str, Any]) -> None:
    windows = evis.dataset.open(small[1]).windows(**how)
    stream = evis.dataset.stream(small[0], sequences=3, arrays="numpy", **how)
    got = list(stream)
    stream.close()
    assert len(got) == len(windows) >= 9
    assert stream.left_out["windows without a label"] == windows.left_out["windows without a label"]
    for a, b in zip(got, windows):
        same(a, b)


def test_an_epoch_of_a_stream_is_that_of_the_data_set(small: Made) -> None:
    """What augmentation draws is another in another epoch, of the same sequences."""
    how: dict[str, Any] = {"seconds": 0.1, "labels": LABELS, "augment": EVERYTHING, "seed": 5}
    windows = evis.dataset.open(small[1]).windows(**how)
    stream = evis.dataset.stream(small[0], sequences=2, arrays="numpy", **how)
    first = next(iter(stream))
    stream.set_epoch(3)
    got = list(stream)
    stream.close()
    assert len(got) == 4 and not np.array_equal(got[0]["events"]["t"], first["events"]["t"])
    for i, sample in enumerate(got):
        same(sample, windows.sample(i, 3))
    with pytest.raises(ValueError, match=r"epoch is 2\.5; it must be a whole number"):
        stream.set_epoch(2.5)


def test_images_whose_exposure_outlasts_the_window_of_their_middle(tmp_path: Path) -> None:
    """Exposures of 30 ms every 33.3 ms have their middles at 15 ms, 48.3 ms, ..., in windows that end before them."""
    changes = [("[forward_flow, backward_flow, boxes, depth, events]", "[]\noutputs: [events, image]"), (": 3", ": 1")]
    arguments = ("shot_rate: 5.0", "keyframe_rate: 120, exposure_ms: 30, image_rate: 30")
    recipe, out = made(tmp_path, *changes, arguments)
    how: dict[str, Any] = {"seconds": 0.01, "labels": ["image"]}
    stream = evis.dataset.stream(recipe, sequences=1, arrays="numpy", **how)
    got = list(stream)
    stream.close()
    assert [int(sample["image_ns"]) for sample in got] == [round(15e6 + k * 1e9 / 30) for k in range(6)]
    for a, b in zip(got, evis.dataset.open(out).windows(**how), strict=True):
        same(a, b)


def check_events(
    where: Path,
    layout: str,
    outputs: str,
    arguments: str,
    least: int,
    how: dict[str, Any],
    unlike: tuple[str, ...] = (),
) -> None:
    """Compares the events of windows, streamed and from files, with those of a simulation.

    outputs, arguments: lines in place of those of the small recipe. unlike: arguments that the simulation is not given.
    """
    lines = ("[forward_flow, backward_flow, boxes, depth, events]", outputs), (": 3", ": 1")
    recipe, out = made(where, ("npz", layout), *lines, ("shot_rate: 5.0", arguments))
    stream = evis.dataset.stream(recipe, sequences=1, arrays="numpy", **how)
    got = list(stream)
    stream.close()
    plan = read_recipe(recipe).sequence(0)
    given = {name: value for name, value in plan.arguments.items() if name not in unlike}
    with evis.Simulation(plan.scene, seed=plan.seed, **given) as sim:
        packets = [step.events for step in [sim.reset(), *sim.run(plan.duration_s)]]
        # A sensor that does not look ahead holds nothing back.
        packets += [packet] if (packet := sim.finish().events) is not None else []
    t = np.concatenate([packet.t for packet in packets])
    for samples in (got, evis.dataset.open(out).windows(**how)):
        assert len(samples) >= least
        for sample in samples:
            assert np.array_equal(sample["events"]["t"], t[(t >= sample["t0_ns"]) & (t < sample["t1_ns"])])


@pytest.mark.parametrize("layout", ["npz", "webdataset", "mcap"])
def test_events_of_a_sensor_that_looks_ahead(layout: str, tmp_path: Path) -> None:
    """It gives the last events of a step with the next one; a window has all of its own."""
    arguments = "crossing: cubic, upsampling: 4, interpolator: rigid"
    check_events(tmp_path, layout, "[]", arguments, 16, {"seconds": 0.03, "stride": 0.01})


@pytest.mark.parametrize("layout", ["npz", "webdataset", "mcap"])
def test_events_beside_images_that_come_faster_than_keyframes(layout: str, tmp_path: Path) -> None:
    """Windows that end between two images of one step have the events of a simulation without images."""
    images = {"image_rate": 100, "exposure_ms": 3}
    arguments = ", ".join(["shot_rate: 5.0", *(f"{name}: {value}" for name, value in images.items())])
    how = {"seconds": 0.05, "stride": 0.01}
    check_events(tmp_path, layout, "[]\noutputs: [events, image]", arguments, 14, how, tuple(images))


@pytest.fixture
def same_arguments(small: Made) -> Path:
    """A recipe whose sequences differ in their seed alone, so that the second is there in no time."""
    recipe = small[0].with_name("same.yaml")
    recipe.write_text(small[0].read_text().replace("omega: {from: 15, to: 70}", "omega: 30"))
    return recipe


def test_splits_numbers_workers(same_arguments: Path) -> None:
    """Each worker has sequences of its own, and together they have what one has."""
    plans = read_recipe(same_arguments).sequences(12)
    how: dict[str, Any] = {"seconds": 0.1, "arrays": "numpy"}
    train = evis.dataset.stream(same_arguments, sequences=3, split="train", **how)
    own = [sample["sequence"] for sample in train]
    assert own == [p.index for p in plans if p.split == "train" for _ in range(2)][:6]
    parts = [[s["sequence"] for s in train.samples(w, 2)] for w in range(2)]
    assert parts == [[*own[:2], *own[4:]], own[2:4]]
    endless = evis.dataset.stream(same_arguments, **how)
    some = list(itertools.islice(endless, 9))
    assert [s["sequence"] for s in some][::2] == [0, 1, 2, 3, 4]
    later = evis.dataset.stream(same_arguments, sequences=1, first=2, **how)
    same(next(iter(later)), some[4])
    ranks = [evis.dataset.stream(same_arguments, sequences=3, rank=r, ranks=2, **how) for r in range(2)]
    assert [[s["sequence"] for s in stream][::2] for stream in ranks] == [[0, 2], [1]]
    for stream in (train, later, endless, *ranks):
        stream.close()


def test_windows_that_wait_come_in_another_order(same_arguments: Path) -> None:
    """All of them once, the same each time."""
    how: dict[str, Any] = {"sequences": 3, "seconds": 0.02, "arrays": "numpy"}
    plain, mixed, again = (
        [(s["sequence"], s["window"]) for s in evis.dataset.stream(same_arguments, shuffle=wait, **how)]
        for wait in (0, 12, 12)
    )
    assert plain != mixed == again and sorted(mixed) == plain
    assert np.abs(np.diff([10 * s + w for s, w in mixed])).mean() > 3
    later = evis.dataset.stream(same_arguments, shuffle=12, **how)
    later.set_epoch(1)
    other = [(s["sequence"], s["window"]) for s in later]
    assert other != mixed and sorted(other) == plain


def test_its_simulations_stay_warm(same_arguments: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A sequence whose arguments are those of the last one resets its simulation."""
    made = []

    class Counted(warm.Simulation):  # type: ignore[misc]
        def __init__(self, *args: Any, **kwargs: Any) -> None:
            made.append(args)
            super().__init__(*args, **kwargs)

    monkeypatch.setattr(warm, "Simulation", Counted)
    stream = evis.dataset.stream(same_arguments, sequences=3, seconds=0.1, arrays="numpy")
    assert len(list(stream)) == 6 and len(made) == 1
    stream.close()


@pytest.mark.gpu
def test_a_stream_on_a_gpu_has_its_labels_there(tmp_path: Path) -> None:
    """Windows and labels of images are tensors there, those that numpy gives of the same simulation; and of one on a
    CPU all but a few pixels at silhouettes."""
    torch = pytest.importorskip("torch")
    recipe = tmp_path / "labels.yaml"
    labels = ["flow", "depth", "segmentation"]
    text = RECIPE.replace("forward_flow, backward_flow, boxes, depth, events", ", ".join(labels))
    recipe.write_text(text.replace("shot_rate: 5.0", "shot_rate: 0.0"))
    how: dict[str, Any] = {"sequences": 1, "seconds": 1 / 30, "representation": "count_image", "labels": labels}
    on_gpu, as_numpy, on_cpu = (
        list(evis.dataset.stream(recipe, **how, **where))
        for where in ({"device": "cuda", "arrays": "torch"}, {"device": "cuda", "arrays": "numpy"}, {"arrays": "numpy"})
    )
    assert len(on_gpu) == len(as_numpy) == len(on_cpu) >= 4
    for there, here, other in zip(on_gpu, as_numpy, on_cpu):
        for name in ("events", *labels):
            assert torch.is_tensor(there[name]) and there[name].device.type == "cuda"
            np.testing.assert_array_equal(there[name].cpu().numpy(), np.asarray(here[name]))
        for name in labels:
            near = np.isclose(np.asarray(here[name]), np.asarray(other[name]), rtol=1e-3, atol=1e-2, equal_nan=True)
            assert near.mean() > 0.99


def test_a_stream_without_events(tmp_path: Path) -> None:
    """Its windows have columns of no rows, and images of nothing."""
    recipe = tmp_path / "dark.yaml"
    text = RECIPE.replace("labels: [forward_flow, backward_flow, boxes, depth, events]", "outputs: [depth]")
    recipe.write_text(text.replace(", shot_rate: 5.0", ""))
    how: dict[str, Any] = {"sequences": 1, "seconds": 0.1, "labels": ["depth"], "arrays": "numpy"}
    first, second = evis.dataset.stream(recipe, **how)
    for sample in (first, second):
        types = {name: (column.dtype.name, len(column)) for name, column in sample["events"].items()}
        assert types == {"t": ("int64", 0), "x": ("uint16", 0), "y": ("uint16", 0), "p": ("uint8", 0)}
    grids = evis.dataset.stream(recipe, representation="voxel_grid", bins=3, **how)
    assert [grid["events"].shape for grid in grids] == [(3, 32, 40)] * 2
