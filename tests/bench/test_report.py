"""The report's runner: what fails is listed and hides nothing else, and what cannot be drawn is there as figures."""

import importlib
import json
import sys
import types

import pytest

from bench import report
from evis.cli import main


@pytest.fixture
def subjects(monkeypatch):
    """Two subjects, one with a plot, and what was done."""
    done = []
    section = {"title": "T", "command": "c", "rows": [{"a": 1}], "note": ""}

    def module(name, **more):
        made = types.ModuleType(f"bench.{name}")
        made.measure = lambda quick: done.append(f"measured {name}") or {"s": section}
        for key, value in more.items():
            setattr(made, key, value)
        monkeypatch.setitem(sys.modules, f"bench.{name}", made)
        monkeypatch.setitem(report.SUBJECTS, name, (f"bench.{name}", "a test"))

    module("drawn", plot=lambda sections, out: done.append("drawn") or [])
    module("plain")
    return done


@pytest.mark.parametrize("there", [True, False])
def test_without_matplotlib_there_are_figures_and_no_plots(subjects, monkeypatch, tmp_path, capsys, there):
    """Nothing is lost but the pictures, and report, page and command say which package draws them."""
    monkeypatch.setattr(report.importlib.util, "find_spec", lambda name: object() if there else None)
    assert main(["bench", "drawn", "plain", "--out", str(tmp_path)]) == 0
    told = capsys.readouterr().err
    assert subjects == (
        ["measured drawn", "drawn", "measured plain"] if there else ["measured drawn", "measured plain"]
    )
    written = json.loads((tmp_path / "report.json").read_text())
    assert written["failures"] == [] and written["subjects"].keys() == {"drawn", "plain"}
    page = (tmp_path / "index.html").read_text()
    for text in (told, page, *written["notes"]):
        assert ("evis[bench]" in text) != there
    assert len(written["notes"]) == (not there)


def test_a_subject_that_fails_hides_no_other(subjects, monkeypatch, tmp_path, capsys):
    """It is listed, with its traceback in a file, and the exit status is 1."""
    monkeypatch.setattr(sys.modules["bench.drawn"], "measure", lambda quick: 1 / 0)
    assert main(["bench", "drawn", "plain", "--out", str(tmp_path)]) == 1
    assert "drawn failed: ZeroDivisionError" in capsys.readouterr().err
    assert subjects == ["measured plain"] and "1 / 0" in (tmp_path / "drawn.traceback.txt").read_text()


def test_a_package_of_the_extra_that_is_missing_is_named(subjects, monkeypatch, tmp_path, capsys):
    """With what installs it."""
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.setattr(sys.modules["bench.plain"], "measure", lambda quick: importlib.import_module("gymnasium"))
    assert main(["bench", "plain", "--out", str(tmp_path)]) == 1
    assert "plain failed: gymnasium is not installed: pip install 'evis[bench]'" in capsys.readouterr().err


@pytest.mark.parametrize("there", [True, False])
def test_own_runs_without_matplotlib_are_figures_and_no_plot(monkeypatch, tmp_path, capsys, there):
    """The table is printed and kept, and one line says which package draws it."""
    run = {"bag": "a.mcap", "scene": "s", "upsampling": "8", "error": 0.25, "run time": 2.0}
    monkeypatch.setattr("bench.interpolation.own_runs.read", lambda bags: [run])
    monkeypatch.setattr("bench.interpolation.own_runs.plot", lambda rows, path: path.write_bytes(b"drawn"))
    monkeypatch.setattr(report.importlib.util, "find_spec", lambda name: object() if there else None)
    assert main(["bench", "--from", "a.mcap", "--out", str(tmp_path)]) == 0
    told = capsys.readouterr()
    assert "a.mcap" in told.out and json.loads((tmp_path / "own_runs.json").read_text()) == [run]
    assert ("evis[bench]" in told.err) != there and (tmp_path / "own_runs.png").exists() == there
