"""Loads other event sensors that run on a GPU with PyTorch, for comparison on the frames that ours is measured on.

Nothing of a peer is part of this project: EVIS_PEERS=DIR, DIR holding checkouts of uzh-rpg/rpg_vid2e and of
spikelab-jhu/isaac-sim-event-camera-plugin, has them. The first one's kernels are compiled by nvcc.
"""

from __future__ import annotations

import importlib.util
import os
import sys
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from bench.event_sensor.signals import SECOND

THRESHOLD = 0.2
Call = Callable[[Any, Any], object]
"""Takes frames, a tensor of linear luminance [K, H, W] on the device, and their stamps [K] there, int64 ns."""


class NotThere(Exception):
    """Signals that a peer cannot be run; its text says why."""


def checkout(pattern: str) -> Path:
    """Finds a file of a peer. Raises NotThere."""
    if not os.environ.get("EVIS_PEERS"):
        raise NotThere("EVIS_PEERS names no folder with a checkout")
    found = next(Path(os.environ["EVIS_PEERS"]).glob(f"**/{pattern}"), None)
    if found is None:
        raise NotThere(f"no {pattern} in EVIS_PEERS={os.environ['EVIS_PEERS']}")
    if importlib.util.find_spec("torch") is None:
        raise NotThere("PyTorch is not installed")
    return found


def loaded(name: str, path: Path) -> Any:
    """Imports a file by a name."""
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def esim_torch(device: str) -> Call:
    """Makes rpg_vid2e's esim_torch, given the logarithm of the frames. Raises NotThere."""
    path = checkout("esim_torch/esim_torch.py")
    import torch
    from torch.utils import cpp_extension

    if not device.startswith("cuda"):
        raise NotThere("it runs on CUDA only")
    try:
        sources = [str(path.with_name("esim_cuda_kernel.cu"))]
        sys.modules["esim_cuda"] = cpp_extension.load("esim_cuda", sources)
    except (RuntimeError, OSError, ImportError) as error:
        raise NotThere(f"its kernels do not build: {str(error).strip().splitlines()[-1]}") from None
    simulator = loaded("esim_torch_of_peer", path).EventSimulator_torch(THRESHOLD, THRESHOLD, 0)
    return lambda frames, t: simulator.forward(torch.log(frames), t)


class Taken:
    """Stands for the recorder of the released EVIS: keeps the last events where they are, on the device."""

    def record(self, *events: Any) -> None:
        """Takes the events of a step."""
        self.last = events


def evis_released(device: str) -> Call:
    """Makes the released EVIS's event core, without noise, a step for each frame. Raises NotThere."""
    path = checkout("dvs_gen/dvs/processor.py")
    for name in ("dvs_gen", "dvs_gen.dvs", "dvs_gen.dvs.recorder"):
        sys.modules[name] = types.ModuleType(name)
    sys.modules["dvs_gen.dvs.recorder"].GeneralDVSRecorder = Taken  # type: ignore[attr-defined]
    module = loaded("dvs_gen.dvs.processor", path)
    processor = module.BatchedMultiCamProcessor(Taken(), "cam0", THRESHOLD)

    def call(frames: Any, t: Any) -> None:
        for frame, stamp in zip(frames, t.tolist()):
            processor(frame[None, :, :, None].expand(-1, -1, -1, 3), stamp / SECOND)

    return call


def peers(device: str) -> Iterator[tuple[str, Call | str]]:
    """Gives the name of each peer, and what it is called by, or why it cannot be."""
    for name, make in (("esim_torch, with ln", esim_torch), ("EVIS v1.0 event core", evis_released)):
        try:
            yield name, make(device)
        except NotThere as reason:
            yield name, str(reason)
