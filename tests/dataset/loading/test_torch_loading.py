"""PyTorch: DataLoaders with workers give what numpy gives; tensors are worked on as arrays are."""

from __future__ import annotations

import multiprocessing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_set import HEIGHT, WIDTH, made, same

import evis
from evis.dataset import Augment
from evis.dataset.augmenting.arrays import uniforms
from evis.dataset.augmenting.changed_events import changed_events
from evis.dataset.augmenting.changed_labels import placed_labels, reversed_labels
from evis.dataset.draws import key_of
from evis.dataset.streaming.rows import Rows

torch: Any = pytest.importorskip("torch", reason="PyTorch is not installed: make test-extras")
pytestmark = pytest.mark.extras

Made = tuple[Path, Path]
EVERYTHING = Augment(flip_x=0.5, flip_y=0.5, reverse=0.5, crop=(20, 24), drop=0.1, noise=10.0)
HOW: dict[str, Any] = {
    "seconds": 1 / 30, "representation": "voxel_grid", "bins": 5, "labels": ["forward_flow", "boxes"],
    "arguments": ["omega"], "augment": EVERYTHING,
}  # fmt: skip


def plain(batch: dict[str, Any]) -> dict[str, Any]:
    """A batch in numpy's arrays."""
    return {n: plain(v) if isinstance(v, dict) else v.numpy() for n, v in batch.items()}


@pytest.mark.parametrize(("workers", "start"), [(0, None), (2, "fork"), (2, "spawn")])
def test_a_loader_gives_what_numpy_gives(small: Made, workers: int, start: str | None) -> None:
    """In as many processes as one likes, however they begin; images by PyTorch's own collate too."""
    windows = evis.dataset.open(small[1]).windows(**HOW)
    data = windows.torch()
    assert isinstance(data, torch.utils.data.Dataset) and len(data) == 18
    loader = torch.utils.data.DataLoader(
        data, batch_size=4, num_workers=workers, multiprocessing_context=start, collate_fn=evis.dataset.collate,
        persistent_workers=bool(workers),
    )  # fmt: skip
    for epoch in (0, 3):  # workers that live on are told too
        data.set_epoch(epoch)
        for a, b in zip(loader, windows.batches(4, epoch=epoch), strict=True):
            same(plain(a), b)
    images = evis.dataset.open(small[1]).windows(**HOW | {"labels": ["forward_flow"]})
    usual = torch.utils.data.DataLoader(images.torch(), batch_size=6)
    for a, b in zip(usual, images.batches(6), strict=True):
        same(plain(a), b)


@pytest.mark.parametrize("start", ["fork", "spawn"])
def test_workers_open_files_of_their_own(tmp_path: Path, start: str) -> None:
    """HDF5, which the parent has open already when workers begin."""
    _, out = made(tmp_path, ("layout: npz", "layout: dsec"), ("depth, events]", "depth]"))
    windows = evis.dataset.open(out).windows(seconds=0.02, representation="count_image")
    expected = list(windows.batches(5))
    loader = torch.utils.data.DataLoader(windows.torch(), 5, num_workers=2, multiprocessing_context=start)
    for a, b in zip(loader, expected, strict=True):
        same(plain(a), b)


def test_raw_events_in_a_loader(small: Made) -> None:
    """Ragged columns, with which tensors make a batch of voxel grids."""
    from evis.events.representations import voxel_grid

    windows = evis.dataset.open(small[1]).windows(events=600)
    loader = torch.utils.data.DataLoader(windows.torch(), 4, collate_fn=evis.dataset.collate)
    for batch, own in zip(loader, windows.batches(4), strict=True):
        same(plain(batch), own)
        ends = batch["t0_ns"].numpy(), batch["t1_ns"].numpy()
        grid = voxel_grid(batch["events"], 5, window=ends, height=HEIGHT, width=WIDTH).values
        assert isinstance(grid, torch.Tensor) and grid.shape[1:] == (5, HEIGHT, WIDTH)


def test_an_iterable_is_shared(small: Made) -> None:
    """Every window once among workers and ranks, in an order of the epoch."""
    windows = evis.dataset.open(small[1]).windows(seconds=1 / 30)

    def seen(data: Any, workers: int) -> list[tuple[int, int]]:
        loader = torch.utils.data.DataLoader(data, batch_size=None, num_workers=workers)
        return [(int(s["sequence"]), int(s["window"])) for s in loader]

    everything = sorted((w["sequence"], w["window"]) for w in windows)
    data = windows.torch_iterable(shuffle=True)
    assert isinstance(data, torch.utils.data.IterableDataset) and len(data) == 18
    first, shared = seen(data, 0), seen(data, 2)
    data.set_epoch(1)
    assert sorted(first) == sorted(shared) == everything and seen(data, 0) != first != everything
    ranks = [seen(windows.torch_iterable(shuffle=True, rank=r, ranks=4), 2) for r in range(4)]
    assert [len(rank) for rank in ranks] == [4] * 4 and len({w for rank in ranks for w in rank}) == 16
    with pytest.raises(ValueError, match="rank is 4 of 4"):
        windows.torch_iterable(rank=4, ranks=4)


def _rank(rank: int, folder: str, out: Any) -> None:
    torch.distributed.init_process_group("gloo", init_method=f"file://{folder}/meet", rank=rank, world_size=2)
    windows = evis.dataset.open(f"{folder}/d").windows(seconds=1 / 30)
    out.put([(int(s["sequence"]), int(s["window"])) for s in windows.torch_iterable(shuffle=True)])
    torch.distributed.destroy_process_group()


def test_ranks_of_torch_distributed(small: Made) -> None:
    """They are found where it is initialised."""
    context = multiprocessing.get_context("spawn")
    out = context.Queue()
    processes = [context.Process(target=_rank, args=(r, str(small[1].parent), out)) for r in range(2)]
    for process in processes:
        process.start()
    parts = [out.get(timeout=120) for _ in processes]
    for process in processes:
        process.join(60)
    (small[1].parent / "meet").unlink(missing_ok=True)
    assert [len(part) for part in parts] == [9, 9] and len(set(parts[0] + parts[1])) == 18


@pytest.mark.parametrize(("workers", "start"), [(0, None), (2, "fork"), (2, "spawn")])
def test_a_stream_in_a_loader(small: Made, workers: int, start: str | None) -> None:
    """Workers simulate sequences of their own; together they give what the data set on the disk gives."""
    data = evis.dataset.stream(small[0], sequences=3, **HOW)
    assert isinstance(data, torch.utils.data.IterableDataset)
    loader = torch.utils.data.DataLoader(
        data, batch_size=None, num_workers=workers, multiprocessing_context=start, persistent_workers=bool(workers)
    )
    windows = evis.dataset.open(small[1]).windows(**HOW)
    for epoch in (0, 3):  # workers that live on are told too
        data.set_epoch(epoch)
        found = {(int(s["sequence"]), int(s["window"])): s for s in loader}
        assert len(found) == len(windows)
        for w in (windows.sample(i, epoch) for i in range(len(windows))):
            got = found[w["sequence"], w["window"]]
            for name, value in w.items():
                same(got[name].numpy() if isinstance(got[name], torch.Tensor) else got[name], value)
    assert set(data.left_out) == {"windows without a label", "sequences that failed"}
    data.close()


def test_tensors_are_changed_as_arrays_are(small: Made) -> None:
    """To the byte, on what stands for a GPU: the same code with PyTorch's functions."""
    data = evis.dataset.open(small[1])
    labels = ["forward_flow", "backward_flow", "boxes", "depth", "events"]
    for k in range(6):
        sample = data.windows(seconds=1 / 30, labels=labels)[k]
        events = sample["events"] | {n: sample[n] for n in ("event_instance", "event_flow", "event_signal")}
        images = {n: v for n, v in sample.items() if hasattr(v, "shape") and not n.startswith("event")}
        drawn = EVERYTHING.drawn(7, 0, 0, k, HEIGHT, WIDTH)
        tensors = [{n: torch.from_numpy(v.copy()) for n, v in group.items()} for group in (events, images)]
        ends = sample["t0_ns"], sample["t1_ns"]
        same(
            plain(changed_events(tensors[0], EVERYTHING, drawn, *ends, HEIGHT, WIDTH)),
            changed_events(events, EVERYTHING, drawn, *ends, HEIGHT, WIDTH),
        )
        a, b = (placed_labels(reversed_labels(g, *ends), drawn, HEIGHT, WIDTH) for g in (tensors[1], images))
        same(plain(a), b)
    assert np.array_equal(uniforms(key_of(1), 3, 500, torch.zeros(1)).numpy(), uniforms(key_of(1), 3, 500, np.zeros(1)))


def test_rows_of_tensors() -> None:
    """Rows by number and by time, as those of arrays."""
    rng = np.random.default_rng(0)
    arrays, tensors, t = Rows(), Rows(), np.sort(rng.integers(1, 1000, 400))
    for start in range(0, 1000, 100):
        part = t[(t > start) & (t <= start + 100)]
        arrays.add({"t": part}, start, start + 100)
        tensors.add({"t": torch.from_numpy(part)}, start, start + 100)
    for limit in (0, 1, 100, 101, 555, 1000, 2000):
        assert arrays.row_of(limit) == tensors.row_of(limit) == np.searchsorted(t, limit)
    assert arrays.drop_before(350) == tensors.drop_before(350) == np.count_nonzero(t <= 300)
    same(plain(tensors.part(250, 380)), arrays.part(250, 380))
    assert np.array_equal(arrays.part(250, 380)["t"], t[250:380]) and arrays.time(399) == t[399]


def test_text_among_tensors(small: Made) -> None:
    """A loader gives a list of texts, by either way of joining."""
    data = evis.dataset.open(small[1])
    for sequence in data:
        sequence.arguments["preset"] = sequence.name
    windows = data.windows(seconds=0.2, representation="count_image", arguments=["preset"]).torch()
    for collate in (None, evis.dataset.collate):
        (batch,) = torch.utils.data.DataLoader(windows, batch_size=3, collate_fn=collate)
        assert list(batch["preset"]) == [sequence.name for sequence in data]
