"""Every benchmark runs to its end at its smallest size and gives what the pages of docs/ show of it."""

from __future__ import annotations

import dataclasses
import importlib
import json
import subprocess
import sys
from pathlib import Path

import pytest

from bench import documents
from bench.command import subject_of
from bench.graph import camera
from bench.report import report_of
from bench.sections import as_html, as_text

ROOT = Path(__file__).parents[2]
SOURCES = {".".join(p.relative_to(ROOT).with_suffix("").parts): p.read_text() for p in (ROOT / "bench").rglob("*.py")}
MEASURING = sorted(name for name, text in SOURCES.items() if "command.run(measure" in text)
BY_ARGUMENTS = {
    "bench.documents": ["--page", "PAGE"],
    "bench.event_hashes": ["--out", "OUT", "--scenes", "spinning_disk"],
    "bench.physics.engines": ["--cases", "1"],
    "bench.physics.environments": ["falling_objects", "--envs", "2", "--keyframes", "2"],
    "bench.streams.peers": ["1"],
}
"""Those that measure nothing by themselves, and what they are given."""
NEEDS_RECORDINGS = "bench.measure.clips"


def with_marks(module: str):
    """Marks a benchmark: those that only measure a GPU run where there is one."""
    return pytest.param(module, marks=pytest.mark.gpu if 'device="cuda"' in SOURCES[module] else pytest.mark.slow)


def test_every_benchmark_is_run():
    """One that is new is found by itself, unless it is run in a way of its own."""
    runnable = {name for name, text in SOURCES.items() if '__name__ == "__main__"' in text}
    assert runnable == {*MEASURING, *BY_ARGUMENTS} and NEEDS_RECORDINGS in MEASURING


@pytest.fixture
def smaller(monkeypatch):
    """Makes what takes many minutes smaller than --quick does."""

    def make(module: str) -> None:
        if module == "bench.interpolation.methods":
            size = {"width": 48, "height": 36}
            methods = importlib.import_module(module)
            few = list(methods.SCENES.items())[:2]
            scenes = {k: dataclasses.replace(c, overrides=c.overrides | size) for k, c in few}
            monkeypatch.setattr(methods, "SCENES", scenes)
            monkeypatch.setattr("bench.interpolation.paths.SIZE", size)

    return make


@pytest.mark.parametrize("module", [with_marks(module) for module in MEASURING])
def test_a_benchmark_runs(module, smaller, tmp_path):
    """Its sections have rows, can be shown and kept, and have the columns that the pages want of them."""
    smaller(module)
    made = importlib.import_module(module)
    try:
        sections = made.measure(True)
    except SystemExit as refusal:
        assert module == NEEDS_RECORDINGS and "EVIS_TEST_DATA" in str(refusal)
        pytest.skip("no recordings")
    assert sections
    for section in sections.values():
        assert section["title"] and section["command"] and section["rows"]
        assert len(as_text(section).splitlines()) > len(section["rows"]) and "<table" in as_html(section)
    subject = subject_of(module)
    report = json.loads(json.dumps(report_of({subject: sections}, True), default=str))
    wanted = [table for page in documents.PAGES for table in documents.tables((ROOT / page).read_text())]
    shown = [table for table in wanted if table.key.startswith(subject + "/")]
    assert documents.collect(report, shown).keys() == {table.key for table in shown}
    if hasattr(made, "plot"):
        pytest.importorskip("matplotlib")
        assert all(path.stat().st_size for path in made.plot(sections, tmp_path))


@pytest.mark.parametrize("rate", [1e6, pytest.param(1e9, marks=pytest.mark.slow)])
def test_a_flood_ends_and_its_bytes_are_counted_once(rate):
    """Each byte is published or lost. At 1 GB/s most are lost, and the last read is a small part of all."""
    seconds = 0.3
    found = camera.flood(rate=rate, seconds=seconds, packet_ms=10.0)
    assert found["received"] + found["lost_in_camera"] + found["lost_in_driver"] == found["offered"] > 0
    assert found["read"]["events"] > 0
    if rate == 1e9:
        assert found["lost_in_camera"] > 0 and found["offered"] == pytest.approx(rate * seconds, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("module", BY_ARGUMENTS)
def test_a_benchmark_with_arguments_runs(module, tmp_path):
    if module == "bench.physics.engines":
        pytest.importorskip("mujoco_warp")
    page = tmp_path / "performance.md"
    page.write_text((ROOT / documents.PAGES[0]).read_text())
    page.with_suffix(".json").write_text((ROOT / documents.PAGES[0]).with_suffix(".json").read_text())
    places = {"PAGE": str(page), "OUT": str(tmp_path / "out.json")}
    words = [places.get(word, word) for word in BY_ARGUMENTS[module]]
    done = subprocess.run([sys.executable, "-m", module, *words], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0 and done.stdout, done.stderr
