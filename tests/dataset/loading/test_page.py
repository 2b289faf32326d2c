"""docs/loading.md: its recipe, and every example as it stands, on the data set that the recipe makes."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from made_set import Here

from evis.dataset.making.make import make
from evis.dataset.recipe_file import read_recipe

PAGE = (Path(__file__).parents[3] / "docs" / "loading.md").read_text()
(RECIPE,) = re.findall(r"^```yaml\n(.*?)^```", PAGE, re.M | re.S)
(TWENTY,) = re.findall(r"^```python twenty\n(.*?)^```", PAGE, re.M | re.S)


def examples(tag: str) -> list[str]:
    """The examples that are marked so."""
    return re.findall(rf"^```python {tag}\n(.*?)^```", PAGE, re.M | re.S)


@pytest.fixture(scope="session")
def page_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the page's recipe and a few sequences of its data set."""
    folder = tmp_path_factory.mktemp("page")
    (folder / "speeds.yaml").write_text(RECIPE)
    assert make(read_recipe(folder / "speeds.yaml"), str(folder / "speeds"), Here, count=4).made == 4
    return folder


def run(body: str) -> None:
    """In a namespace of its own; lines count as in the example."""
    exec(compile(body, "loading.md, example", "exec"), {"__name__": "__main__"})


@pytest.mark.parametrize("body", examples("data"))
def test_an_example_runs(body: str, page_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(page_folder)
    run(body)


@pytest.mark.extras
@pytest.mark.parametrize("body", examples("data torch"))
def test_an_example_with_pytorch_runs(body: str, page_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed: make test-extras")
    monkeypatch.chdir(page_folder)
    run(body)


@pytest.mark.extras
@pytest.mark.slow
def test_twenty_lines_train(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As they stand, on the whole data set: the loss falls, and held-out disks are guessed better than by the mean."""
    pytest.importorskip("torch", reason="PyTorch is not installed: make test-extras")
    assert len([line for line in TWENTY.splitlines() if line]) <= 20
    (tmp_path / "speeds.yaml").write_text(RECIPE)
    monkeypatch.chdir(tmp_path)
    assert make(read_recipe("speeds.yaml"), "speeds", Here).made == 60
    run(TWENTY)
    out = capsys.readouterr().out
    losses = [float(loss) for loss in re.findall(r"loss ([\d.]+)", out)]
    assert len(losses) == 15 and sum(losses[-3:]) < 0.75 * sum(losses[:3])
    ((held, mean),) = re.findall(r"held out: ([\d.]+) rad/s; always the mean: ([\d.]+)", out)
    assert float(held) < 0.7 * float(mean)
