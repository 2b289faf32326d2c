"""Every Python example of README and docs runs as it stands, each by itself."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
import warp as wp

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
EXAMPLES = [
    pytest.param(page, body, id=f"{page.name}-{n}")
    for page in PAGES
    for n, body in enumerate(re.findall(r"^```python\n(.*?)^```", page.read_text(), re.M | re.S))
]


@pytest.fixture(autouse=True)
def no_other_graphs(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """An example asks for the newest graph, which must not be one of another test; sockets need a short path."""
    with tempfile.TemporaryDirectory(prefix="evis-", ignore_cleanup_errors=True) as folder:
        monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
        yield


def run(page: Path, body: str) -> None:
    """In a namespace of its own; lines count as in the example."""
    exec(compile(body, f"{page.name}, example", "exec"), {"__name__": "__main__"})


def test_there_are_examples() -> None:
    """So that a change of style of the pages is noticed."""
    assert len(EXAMPLES) >= 3


@pytest.mark.parametrize(("page", "body"), EXAMPLES)
def test_an_example_runs(page: Path, body: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where there is no GPU, what is for one runs on the CPU."""
    monkeypatch.chdir(tmp_path)
    run(page, body if wp.is_cuda_available() else body.replace('"cuda"', '"cpu"'))


@pytest.mark.gpu
@pytest.mark.parametrize(("page", "body"), [example for example in EXAMPLES if '"cuda"' in example.values[1]])
def test_an_example_for_a_gpu_runs_on_one(
    page: Path, body: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run(page, body)
