"""Chooses who makes the sequences: processes of this machine, or a Ray cluster."""

from __future__ import annotations

import os
from collections.abc import Callable

from evis.dataset.errors import DatasetError
from evis.dataset.making.batches import batch_size
from evis.dataset.making.processes import Processes
from evis.dataset.making.tasks import Workers
from evis.dataset.recipe import Recipe

PER_GPU = 14
"""Most workers that share a GPU, where there are cores for them: one writes on its core while others compute. On an
H200 14 make 2.2 times as many sequences as 4 (docs/dataset.md)."""


def workforce(recipe: Recipe, count: int | None, address: str | None) -> Callable[[str], Workers]:
    """Returns what makes the workers of a recipe, for the place that it goes to.

    Args:
        count: of workers; not given, one per core, or PER_GPU for each GPU for a recipe that computes there.
        address: of a Ray cluster, `auto` for the one that this machine belongs to; None = processes of this machine.

    Raises DatasetError where the extra lacks.
    """
    on_gpu = computes_on_gpu(recipe)
    if address is None:
        gpus = len(gpu_memory()) if on_gpu else 0
        number = count or usual_workers(gpus)
        return lambda out: Processes(number, out, gpus)
    try:
        from evis.dataset.making.cluster import Actors
    except ModuleNotFoundError as error:
        if error.name != "ray":
            raise
        raise DatasetError(
            "--address needs Ray: pip install 'evis[cluster]'; without --address workers are processes"
        ) from None
    return lambda out: Actors(count, out, address, PER_GPU if on_gpu else 0)


def usual_workers(gpus: int) -> int:
    """Returns how many workers this machine has: one per core, or some for each GPU."""
    cores = len(os.sched_getaffinity(0))
    return gpus * max(1, min(PER_GPU, cores // gpus)) if gpus else cores


def usual_batch(recipe: Recipe, sequences: int, count: int | None) -> int:
    """Returns how many sequences a worker makes at once: on a CPU one, which is fastest there.

    count: of workers, None = as many as usual.
    """
    memory = gpu_memory() if computes_on_gpu(recipe) else []
    if not memory:  # or GPUs of other machines, of which nothing is known
        return 1
    workers = count or usual_workers(len(memory))
    on_one = -(-workers // len(memory))
    return batch_size(recipe, sequences, workers, min(memory) // (2 * on_one))


def computes_on_gpu(recipe: Recipe) -> bool:
    """Says whether sequences of a recipe are made on a GPU."""
    return any(str(value).startswith("cuda") for scene in recipe.scenes for value in devices(scene.corners()))


def devices(corners: list[dict[str, object]]) -> list[object]:
    """Lists the devices on which a scene's sequences run."""
    return [arguments.get("device", "cpu") for arguments in corners]


def gpu_memory() -> list[int]:
    """Lists the memory [bytes] of the GPUs that this process may use."""
    import warp as wp

    wp.init()
    return [int(device.total_memory) for device in wp.get_cuda_devices()]
