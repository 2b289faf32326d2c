"""PyTorch: tensors go in and come out, in the same memory, in a training loop."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import evis
from evis.events.representations import count_image, time_surface, voxel_grid

torch: Any = pytest.importorskip("torch", reason="PyTorch is not installed: make test-extras")
pytestmark = pytest.mark.extras

DEVICES = ["cpu", pytest.param("cuda", marks=pytest.mark.gpu)]
NAMES = ("t", "x", "y", "p")
MS = 1_000_000
FAULTS: dict[str, Any] = {"threshold_mismatch": 0.03, "refractory_us": 300.0, "leak_rate": 5.0}


def video(shape: tuple[int, ...]) -> np.ndarray:
    return np.exp(np.cumsum(np.random.default_rng(0).normal(0, 0.2, shape), 1)).astype(np.float32)


def stamps(frames: int) -> np.ndarray:
    return np.arange(frames, dtype=np.int64) * MS


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("colour", [False, True])
@pytest.mark.parametrize("params", [{}, FAULTS], ids=str)
def test_tensors_in_tensors_out(device: str, colour: bool, params: dict[str, Any]) -> None:
    frames, t = video((2, 9, 6, 8, 3) if colour else (2, 9, 6, 8)), stamps(9)
    expected = evis.EventSensor(6, 8, 2, colour=colour, device=device, **params)(frames, t)
    sensor = evis.EventSensor(6, 8, 2, colour=colour, **params)
    for part in (slice(0, 1), slice(1, 9)):
        events = sensor(torch.from_numpy(frames[:, part].copy()).to(device), torch.from_numpy(t[part]))
    first = evis.EventSensor(6, 8, 2, colour=colour, device=device, **params)
    first(frames[:, :1], t[:1])
    expected = first(frames[:, 1:], t[1:])
    for name in (*NAMES, *(["c"] if colour else [])):
        column = getattr(events, name)
        assert isinstance(column, torch.Tensor) and column.device.type == device
        assert np.array_equal(column.cpu().numpy(), getattr(expected, name))
    assert len(events) > 50


def test_a_tensor_is_not_copied(monkeypatch: pytest.MonkeyPatch) -> None:
    from nodes.event_sensor import batches as inner

    met: list[Any] = []
    taken = inner.on_device
    monkeypatch.setattr(inner, "on_device", lambda v, d: met.append(taken(v, d)) or met[-1])
    frames = torch.from_numpy(video((1, 9, 6, 8)))
    evis.EventSensor(6, 8)(frames, stamps(9))
    assert met[0].ptr == frames.data_ptr()


@pytest.mark.parametrize("change", ["requires_grad", "transposed", "every_second"])
def test_tensors_of_all_sorts(change: str) -> None:
    frames = torch.from_numpy(video((1, 10, 6, 8)))
    if change == "requires_grad":
        frames.requires_grad_(True)
    elif change == "transposed":
        frames = frames.permute(0, 1, 3, 2).contiguous().permute(0, 1, 3, 2)
    else:
        frames = frames[:, ::2]
    t = stamps(frames.shape[1])
    events = evis.EventSensor(6, 8)(frames, t)
    expected = evis.EventSensor(6, 8)(frames.detach().numpy().copy(), t)
    assert all(np.array_equal(getattr(events, n).numpy(), getattr(expected, n)) for n in NAMES)


def test_a_tensor_of_another_type_is_refused() -> None:
    with pytest.raises(ValueError, match="frames are float64; they must be linear luminance in float32: convert them"):
        evis.EventSensor(6, 8)(torch.ones((1, 2, 6, 8), dtype=torch.float64), stamps(2))


@pytest.mark.parametrize("device", DEVICES)
def test_representations_of_tensors(device: str) -> None:
    rng = np.random.default_rng(1)
    columns = {"t": np.sort(rng.integers(0, 10**7, 300)), "x": rng.integers(0, 9, 300), "y": rng.integers(0, 6, 300)}
    columns["p"] = rng.integers(0, 2, 300)
    tensors = {n: torch.from_numpy(c).to(device) for n, c in columns.items()} | {"env_offsets": np.array([0, 100, 300])}
    tensors["p"] = tensors["p"].bool()
    arrays = columns | {"env_offsets": tensors["env_offsets"]}
    for make in (
        lambda e: voxel_grid(e, 5, normalise=True, height=6, width=9),
        lambda e: count_image(e, height=6, width=9),
        lambda e: time_surface(e, 10**6, height=6, width=9),
    ):
        ours, theirs = make(tensors), make(arrays)
        assert ours.values.device.type == ours.outside.device.type == device
        np.testing.assert_allclose(ours.values.cpu().numpy(), theirs.values, rtol=1e-5, atol=1e-6)


def test_in_a_training_loop() -> None:
    """A disk of light goes left or right, and a line of weights learns which from the events' voxel grid."""
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:16, :24]
    t = stamps(12)
    net = torch.nn.Sequential(torch.nn.Conv2d(4, 4, 5), torch.nn.ReLU(), torch.nn.Flatten(), torch.nn.LazyLinear(1))
    net(torch.zeros(1, 4, 16, 24))
    optimiser = torch.optim.Adam(net.parameters(), 0.01)
    sensor = evis.EventSensor(16, 24, 16, shot_rate=5.0)
    right: list[float] = []
    for _ in range(25):
        ways = rng.choice([-1, 1], 16)
        at = 12 + rng.uniform(-4, 4, 16)[:, None] + ways[:, None] * np.linspace(-4, 4, 12)
        frames = 1 + 3 * (np.hypot(x - at[..., None, None], y - 8) < 4).astype(np.float32)
        sensor.reset()
        events = sensor(torch.from_numpy(frames), t)
        guess = net(voxel_grid(events, 4, window=(0, int(t[-1]))).values)[:, 0]
        loss = torch.nn.functional.softplus(-guess * torch.from_numpy(ways)).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        right.append(float(((guess > 0).numpy() == (ways > 0)).mean()))
    assert np.mean(right[:3]) < 0.85 < 0.95 < np.mean(right[-5:])


DOCS = Path(__file__).parents[2] / "docs"
EXAMPLES = [
    pytest.param(body, id=page.name)
    for page in sorted(DOCS.glob("*.md"))
    for body in re.findall(r"^```python torch\n(.*?)^```", page.read_text(), re.M | re.S)
]


@pytest.mark.parametrize("body", EXAMPLES)
def test_the_examples_of_the_pages(body: str) -> None:
    exec(compile(body, "example", "exec"), {"__name__": "__main__"})
