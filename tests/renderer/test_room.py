"""More environments than the memory holds are refused before any is made."""

from pathlib import Path
from types import SimpleNamespace

import pytest

import evis
from evis.gpu import room
from evis.gpu.room import free_memory
from nodes.renderer import at_once
from nodes.renderer.at_once import LEAST_OF_REFINED, LEAST_OF_RIGID, check_room

CPU = SimpleNamespace(is_cuda=False)


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that stands for what the system says of its memory."""
    monkeypatch.setattr(room, "MEMINFO", tmp_path / "meminfo")
    monkeypatch.setattr(room, "CGROUP", tmp_path)
    (tmp_path / "meminfo").write_text("MemTotal:  16000 kB\nMemFree: 500 kB\nMemAvailable:    9000 kB\n")
    return tmp_path


def test_a_cpu_has_what_is_available(machine: Path) -> None:
    assert free_memory(CPU) == 9000 * 1024


@pytest.mark.parametrize("limit, left", [("max", 9000 * 1024), ("1000000", 400_000 + 50_000), ("500000", 0)])
def test_a_container_leaves_less(machine: Path, limit: str, left: int) -> None:
    (machine / "memory.max").write_text(f"{limit}\n")
    (machine / "memory.current").write_text("600000\n")
    (machine / "memory.stat").write_text("anon 7\ninactive_file 50000\nactive_file 9\n")
    assert free_memory(CPU) == left


def test_a_container_of_the_older_kind(machine: Path) -> None:
    (machine / "memory").mkdir()
    (machine / "memory" / "memory.limit_in_bytes").write_text("1000000\n")
    (machine / "memory" / "memory.usage_in_bytes").write_text("600000\n")
    (machine / "memory" / "memory.stat").write_text("total_inactive_file 0\n")
    assert free_memory(CPU) == 400_000


def test_a_system_that_tells_nothing(machine: Path) -> None:
    (machine / "meminfo").unlink()
    assert free_memory(CPU) is None


def test_the_error_names_sizes_and_how_many_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(at_once, "free_memory", lambda device: 10_000_000)
    check_room("renderer", "cpu", 10, 100, 100, 5)
    check_room("renderer", "cpu", 1, 10000, 10000, 5)
    with pytest.raises(ValueError) as caught:
        check_room("renderer", "cpu", 11, 100, 100, 5)
    assert str(caught.value) == (
        "renderer: envs:=11 of 100x100 with 5 frames a keyframe take 0.0 GB of memory at least on cpu, of which "
        "0.0 GB are free; envs:=10 are the most that may fit"
    )
    with pytest.raises(ValueError, match="envs:=3 are the most"):
        check_room("interpolator", "cpu", 10, 100, 100, 5, LEAST_OF_RIGID)
    # 4 x 4 samples of 50 x 50 pixels, at (700 + 4 x 5) bytes each.
    with pytest.raises(ValueError, match=r"1 of 200x200 .* are free; take a smaller image, or supersampling:=2$"):
        check_room("interpolator", "cpu", 1, 200, 200, 5, LEAST_OF_REFINED, 4)
    check_room("interpolator", "cpu", 1, 100, 100, 5, LEAST_OF_REFINED, 2)
    monkeypatch.setattr(at_once, "free_memory", lambda device: None)
    check_room("renderer", "cpu", 65536, 8192, 8192, 5)


def test_a_graph_is_not_built() -> None:
    """65,536 environments of these would take terabytes."""
    with pytest.raises(ValueError, match=r"envs:=65536 of 640x480 with 8 frames a keyframe take .* GB"):
        evis.Simulation("spinning_disk", envs=65536, width=640, height=480)
