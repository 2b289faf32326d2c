"""Numbers of a compiled MuJoCo model that MuJoCo takes and that nothing can be simulated with."""

from __future__ import annotations

from typing import Any

from evis.scene.errors import SceneError

TIMESTEP = (1e-7, 1e9)
"""Shortest and longest step of a model [s]: a shorter one has no whole nanoseconds to speak of, stamps end at a longer
one."""


def check_numbers(file: str, model: Any) -> None:
    """Raises SceneError that names the file and the element for a number that nothing can be simulated with."""
    shortest, longest = TIMESTEP
    if not shortest <= model.opt.timestep <= longest:
        raise SceneError(
            f"{file}: <option> has timestep {model.opt.timestep:g}; it must be from {shortest:g} to {longest:g} s"
        )
