"""Imports run one way: nodes -> evis -> msgs; a node's pure part may use another's along the data's way only."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
OURS = ("msgs", "evis", "nodes", "bench", "tests")
FLOW = ("physics", "renderer", "interpolator", "event_sensor", "labeler")
"""The data's way. The labeler stands beside the sensor and may use the renderer's parts, as the interpolator may."""
MAY_USE = {
    "interpolator": {"renderer"},
    "event_sensor": {"interpolator", "renderer"},
    "labeler": {"renderer"},
    "audit": {"event_sensor", "interpolator", "renderer"},
    "frame_camera": {"event_sensor", "interpolator"},
}
WHOLE_CHAIN = ("nodes", "interpolator", "auto")
"""What measures the whole chain may use all of it, and no node uses that."""
CHAIN = {"physics", "renderer", "interpolator", "event_sensor"}


def imported(path: Path) -> set[str]:
    """Every module that a file imports, wherever in the file it does."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(), str(path))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import; import from the top"
            names |= {node.module or ""} | {f"{node.module}.{alias.name}" for alias in node.names}
    return {n for n in names if n.split(".")[0] in OURS}


def violations(path: Path) -> list[str]:
    """The imports of one file that the rule forbids."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    bad = []
    for name in sorted(imported(path)):
        other = name.split(".")
        allowed = {
            "msgs": other[0] == "msgs",
            "evis": other[0] in ("msgs", "evis")
            or parts[1] in ("cli", "simulation", "env", "dataset", "demo", "event_sensor"),
            "nodes": other[0] in ("msgs", "evis", "nodes"),
            "bench": other[0] != "tests",
        }[parts[0]]
        if (
            parts[0] in ("evis", "nodes")
            and other[:2] == ["evis", "cli"]
            and parts[1] not in ("cli", "demo", "__main__")
        ):
            allowed = False
        if parts[0] == "nodes" and other[0] == "nodes" and len(other) > 1 and len(parts) > 2 and other[1] != parts[1]:
            allowed = other[1] in (CHAIN if parts[:3] == WHOLE_CHAIN else MAY_USE.get(parts[1], set()))
        if parts[0] == "nodes" and parts[:3] != WHOLE_CHAIN and tuple(other[:3]) == WHOLE_CHAIN:
            allowed = False
        if other[0] == "nodes" and len(other) > 2 and other[2] == "node" and parts[0] != "bench":
            allowed = False
        if not allowed:
            bad.append(f"{path.relative_to(ROOT)} imports {name}")
    return bad


@pytest.mark.parametrize("package", ["msgs", "evis", "nodes", "bench"])
def test_arrows_run_one_way(package: str) -> None:
    files = sorted((ROOT / package).rglob("*.py"))
    assert files, f"no files in {package}"
    assert [line for path in files for line in violations(path)] == []


def test_the_rule_can_fail(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The checker finds an import planted against the arrow, inside a function too."""
    monkeypatch.setattr(f"{__name__}.ROOT", tmp_path)
    cases = {
        "msgs/a.py": "import evis.runtime.node",
        "evis/bus/a.py": "def f():\n    from nodes.physics import node",
        "nodes/renderer/a.py": "from nodes.interpolator.splat.splat import warp",
        "nodes/labeler/a.py": "from nodes.renderer.node import RendererNode",
        "nodes/interpolator/b.py": "from nodes.interpolator.auto.probe import probe",
    }
    for name, text in cases.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        assert violations(path), name


def test_the_bus_knows_no_message() -> None:
    """It carries whatever derives from Message: a new one with environments of its own needs no change there."""
    allowed = {"msgs.codec", "msgs.fields", "msgs.header", "msgs.topics"}
    files = sorted((ROOT / "evis/bus").rglob("*.py"))
    found = {".".join(n.split(".")[:2]) for path in files for n in imported(path) if n.startswith("msgs.")}
    assert found and found <= allowed


def test_no_python_in_launch() -> None:
    assert not list((ROOT / "launch").rglob("*.py"))
