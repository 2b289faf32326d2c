"""Lists the runs that are measured, each a row of a table, and the speed that each is to reach on one NVIDIA H200."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

SIZE = (640, 480)
SMALL = (128, 128)
DISK = "spinning_disk"
MANY = 1024


@dataclass(frozen=True)
class Case:
    """Describes a run. goal: of an H200, of the real-time factor of each environment, or of all together in env-s/s.

    engine: what moves a MuJoCo model, empty = MuJoCo. tolerance: of time, for samples between frames [s]. needs_gb:
    memory of the device without which it is not begun.
    """

    scene: str
    rate: int
    upsampling: int
    envs: int = 1
    size: tuple[int, int] = SIZE
    record: bool = False
    engine: str = ""
    tolerance: float = 0.0
    goal: float | None = None
    needs_gb: float = 1.0
    quick: bool = False

    @property
    def name(self) -> str:
        """Gives the name of the row.

        As `warehouse 8 x 60x4`, `disk 30x8 recorded`, `cart_pole 30x8 mujoco_warp`, `drone 30x4 0.3 ms`.
        """
        envs = f"{self.envs} x " if self.envs > 1 else ""
        small = f" {self.size[0]}x{self.size[1]}" if self.size != SIZE else ""
        scene = "disk" if self.scene == DISK else self.scene
        between = f"{1e3 * self.tolerance:g} ms"
        more = [[self.engine] * bool(self.engine), [between] * (self.tolerance > 0), ["recorded"] * self.record]
        told = "".join(f" {word}" for words in more for word in words)
        return f"{scene} {envs}{self.rate}x{self.upsampling}{small}{told}"

    @property
    def speed_of_all(self) -> bool:
        """Tells whether its speed is that of all environments together, in env-s/s, rather than of each."""
        return self.envs >= MANY

    def args(self, device: str, **others: Any) -> dict[str, Any]:
        """Gives the arguments of `evis launch`, those that differ from the defaults."""
        of_run: dict[str, Any] = {"device": device, "width": self.size[0], "height": self.size[1]}
        of_run |= {"physics": self.engine} if self.engine else {}
        return of_run | {"keyframe_rate": self.rate, "upsampling": self.upsampling, "envs": self.envs} | others

    def command(self, device: str, *others: str) -> str:
        """Writes the command that a user would give."""
        words = [f"{name}:={value}" for name, value in self.args(device).items()] + list(others)
        record = " --record FILE.mcap" if self.record else ""
        return f"evis launch {self.scene} {' '.join(words)} --compose --no-view --json{record}"


CASES: Sequence[Case] = (
    Case("warehouse", 30, 8, goal=40),
    Case("warehouse", 125, 8, goal=12),
    Case("warehouse", 1000, 1, goal=3),
    Case(DISK, 30, 8, goal=60, quick=True),
    Case(DISK, 125, 8, goal=16),
    Case(DISK, 1000, 1, goal=5),
    Case("drone", 30, 8, quick=True),
    Case("drone", 125, 8),
    Case("drone", 1000, 1),
    Case("warehouse", 60, 4, envs=8, goal=8),
    Case(DISK, 30, 8, envs=MANY, size=SMALL, goal=3000, needs_gb=20),
    Case("warehouse", 30, 8, envs=MANY, size=SMALL, goal=500, needs_gb=20),
    Case("falling_objects", 30, 8, envs=MANY, size=SMALL, goal=500, needs_gb=20),
    Case("falling_objects", 30, 8, envs=MANY, size=SMALL, engine="mujoco_warp", goal=500, needs_gb=20),
    Case("robot_arm", 30, 8, envs=MANY, size=SMALL, goal=500, needs_gb=20),
    Case("robot_arm", 30, 8, envs=MANY, size=SMALL, engine="mujoco_warp", goal=500, needs_gb=20),
    *(Case(scene, 30, 4, tolerance=0.0003) for scene in (DISK, "drone", "warehouse", "fidget_spinner")),
    *(Case(scene, 30, 8, tolerance=0.0001) for scene in (DISK, "drone", "warehouse", "fidget_spinner")),
    Case("warehouse", 30, 8, record=True, goal=6),
    Case(DISK, 30, 8, record=True, goal=4, quick=True),
)
DEFAULTS: Sequence[Case] = tuple(
    Case(scene, rate, k, quick=(scene, rate) == (DISK, 30))
    for rate, k in ((30, 8), (125, 8))
    for scene in ("warehouse", DISK, "drone")
)
"""With the defaults: an audit, and samples between frames as they are by default."""
STARTS: Sequence[Case] = (Case("warehouse", 30, 8, goal=8), Case(DISK, 30, 8, goal=8, quick=True))
"""From the command to the first event, with an empty cache of kernels and with a full one."""

ROOFS: Sequence[Case] = (Case("warehouse", 30, 8), Case(DISK, 30, 8, quick=True))
"""Those whose kernels are held against what the device can do."""


def chosen(cases: Sequence[Case], rows: Sequence[str], quick: bool) -> list[Case]:
    """Picks the cases of which the name has one of the words in it; without words all, or those of a quick run."""
    if rows:
        return [case for case in cases if any(word in case.name for word in rows)]
    return [case for case in cases if case.quick or not quick]
