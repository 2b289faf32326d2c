"""The renderers beside ours draw in whichever order libraries were imported."""

import subprocess
import sys

DRAW = """
from bench.renderer import mujoco, peers
scene, poses = peers.disk((64, 48))
draw = mujoco.drawing(scene, poses[0, 0], True)
print("no OpenGL" if draw is None else draw().tobytes().hex())
"""


def test_mujoco_draws_after_physics_has_imported_it(monkeypatch):
    """The same image as in a process of its own; none on a machine without OpenGL."""
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    alone, after = (
        subprocess.run([sys.executable, "-c", first + DRAW], capture_output=True, text=True)
        for first in ("", "import nodes.physics.engines.mujoco_engine")
    )
    assert alone.returncode == after.returncode == 0, after.stderr
    assert alone.stdout == after.stdout and alone.stdout.strip()
