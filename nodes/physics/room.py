"""Refuses intervals whose sub-steps take more memory than there is, before it is asked for."""

from __future__ import annotations

from evis.gpu.room import free_host_memory

ROW = 13 * 8
"""Bytes of a body's pose and twist."""

BESIDE = 3
"""Times the memory of its states that an interval takes at least (3.3 were measured): they are made of others, which
lie beside them."""

SMALL = 1 << 28
"""Bytes below which nobody asks how much memory is left."""


def check_room(span_ns: int, steps: int, bodies: int, envs: int = 1) -> None:
    """Raises ValueError where the states of an interval of `span_ns` [ns] do not fit into the memory that is left.

    steps: instants of the interval with states. bodies: those that may move. envs: with states of their own.
    """
    need = BESIDE * ROW * steps * bodies * envs
    free = free_host_memory() if need > SMALL else None
    if free is None or need <= free:
        return
    places = f" in {envs} environments" if envs > 1 else ""
    raise ValueError(
        f"the states of {bodies} bodies{places} at the {steps} sub-steps of {span_ns * 1e-9:.4g} s between two "
        f"keyframes take {need / 1e9:,.1f} GB of memory at least, of which {free / 1e9:,.1f} GB are free; "
        "a higher keyframe_rate makes it less"
    )
