"""`import evis` is quick, and brings what it promises only when it is used."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

import evis

ROOT = Path(__file__).parents[2]
HEAVY = {"numpy", "warp", "mujoco", "zmq", "torch", "gymnasium", "yaml", "msgpack", "PIL", "aiohttp"}
SLOW_STANDARD = {
    "typing",
    "re",
    "pathlib",
    "ast",
    "inspect",
    "dataclasses",
    "asyncio",
    "tempfile",
    "importlib.metadata",
}
"""Parts of the standard library that take more than a millisecond each; all of evis takes a dozen."""


def _after(code: str) -> Any:
    """What a new interpreter prints as JSON, without the site's own imports."""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    return json.loads(run.stdout)


def test_importing_evis_imports_nothing_heavy() -> None:
    """Time is not measured in tests: what takes it is named."""
    before, after = _after(
        "import sys; a = list(sys.modules); import evis; import json; print(json.dumps([a, list(sys.modules)]))"
    )
    brought = set(after) - set(before) - {name for name in after if name.startswith("json")}
    assert {name.partition(".")[0] for name in brought} & HEAVY == set()
    # json, which says so, brings re itself.
    assert brought & (SLOW_STANDARD - {"re"}) == set()
    assert {name for name in brought if name.startswith("evis.")} == {
        "evis.console",
        "evis.console.interrupt",
        "evis.neighbours",
    }


@pytest.mark.parametrize("name", evis.__all__)
def test_a_public_name_is_there(name: str) -> None:
    """In the table, in dir(), as an attribute, and by `from evis import`."""
    assert name in dir(evis)
    assert getattr(evis, name).__doc__
    assert _after(f"from evis import {name}; print({name} is not None and 1)") == 1


def test_the_table_is_complete() -> None:
    assert sorted(evis.__all__) == sorted({*evis._LAZY, "__version__"})


def test_all_names_by_star() -> None:
    have = _after("import json\nfrom evis import *\nprint(json.dumps(sorted(globals())))")
    assert set(evis.__all__) <= set(have)


def test_the_version_is_the_package_s() -> None:
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert evis.__version__ == declared


def test_an_unknown_name_lists_the_known() -> None:
    with pytest.raises(AttributeError, match=r"no attribute 'opne'; it has .*load_scene"):
        _ = evis.opne
    assert not hasattr(evis, "__wrapped__")


def test_type_checkers_see_every_name(tmp_path: Path) -> None:
    """The names under TYPE_CHECKING and the table are the same, with types."""
    uses = "\n".join(f"reveal_type(evis.{name})" for name in evis.__all__)
    (tmp_path / "use.py").write_text(f"import evis\n{uses}\nevis.opne\n")
    command = [sys.executable, "-m", "mypy"]  # with the cache that `make lint` has filled
    run = subprocess.run([*command, str(tmp_path / "use.py")], cwd=ROOT, capture_output=True, text=True, timeout=300)
    seen = [line for line in run.stdout.splitlines() if "Revealed type" in line]
    assert len(seen) == len(evis.__all__) and not [line for line in seen if '"Any"' in line], run.stdout
    assert 'Module has no attribute "opne"' in run.stdout
