"""The report's runner: what fails is listed, at once where it could be known, and hides nothing else."""

import json
import sys
import types

import pytest

from bench import report


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
        monkeypatch.setitem(report.SUBJECTS, name, "a test")

    module("drawn", plot=lambda sections, out: done.append("drawn") or [])
    module("plain")
    return done


@pytest.mark.parametrize("there", [True, False])
def test_a_plot_that_cannot_be_drawn_is_told_before_anything_is_measured(subjects, monkeypatch, tmp_path, there):
    spec = object() if there else None
    monkeypatch.setattr(report.importlib.util, "find_spec", lambda name: spec)
    found = report.run(["drawn", "plain"], tmp_path, True, lambda text: None)
    if there:
        assert subjects == ["measured drawn", "drawn", "measured plain"] and found["failures"] == []
    else:
        assert subjects == ["measured plain"]
        assert [f["subject"] for f in found["failures"]] == ["drawn"]
        assert "pip install 'evis[bench]'" in found["failures"][0]["error"]
    written = json.loads((tmp_path / "report.json").read_text())
    assert written["failures"] == found["failures"] and "plain" in written["subjects"]
