"""From an MJCF file to MuJoCo's model, and what MuJoCo says against a file in one line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco

from evis.scene.errors import SceneError
from evis.scene.folders import Folders
from evis.scene.mjcf.check import check_model
from evis.scene.mjcf.numbers import check_numbers


def compile_mjcf(path: Path, folders: Folders, deepest: bool = False) -> Any:
    """Compiles an MJCF file to its MjModel. Raises SceneError in one line that names the file.

    deepest: with a sensor of the least distance of its contacts, as the last.
    """
    check_model(path, folders)
    if deepest:
        return compiled(path, lambda: with_deepest(mujoco.MjSpec.from_file(str(path))))
    return compiled(path, lambda: mujoco.MjModel.from_xml_path(str(path)))


def with_deepest(spec: Any) -> Any:
    """Compiles an MjSpec with a sensor of the least distance of all contacts [m], 0 while there are none."""
    distance = 1 << int(mujoco.mjtConDataField.mjCONDATA_DIST)
    # the last two: reduced to the least distance, of one contact
    spec.add_sensor(type=mujoco.mjtSensor.mjSENS_CONTACT, intprm=[distance, 1, 1])
    return spec.compile()


def compiled(path: Path, compile_it: Callable[[], Any]) -> Any:
    """Returns what `compile_it` returns, and turns what MuJoCo raises into a SceneError of one line that names the
    file; as it does for numbers that MuJoCo lets pass and that nothing can be simulated with.
    """
    try:
        model = compile_it()
    except (ValueError, RuntimeError, MemoryError) as error:
        if isinstance(error, SceneError):
            raise
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        if "unknown exception" in str(error) or not lines:
            lines = ["MuJoCo cannot read it; most likely it needs more memory than there is"]
        raise SceneError(f"{path.name}: {'; '.join(lines)}") from None
    check_numbers(path.name, model)
    return model
