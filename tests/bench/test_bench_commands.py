"""Every benchmark answers --help, and writes a report that others read."""

import json
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from bench import command
from bench.report import BY_THEMSELVES, SUBJECTS
from evis.cli import main

ROOT = Path(__file__).parents[2]
RUN = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in (ROOT / "bench").rglob("*.py")
    if '__name__ == "__main__"' in path.read_text()
)


def test_there_are_benchmarks_to_look_at():
    """`evis bench --help` names each of them once: those that it runs, and those that run by themselves."""
    assert len(RUN) > 20 and sorted([*(module for module, _ in SUBJECTS.values()), *BY_THEMSELVES]) == RUN


def test_the_help_text_keeps_names_and_sentences_apart(capsys):
    """Also beside the longest name."""
    assert main(["bench", "--help"]) == 0
    told = capsys.readouterr().out.splitlines()
    for name, what in [*((name, what) for name, (_, what) in SUBJECTS.items()), *BY_THEMSELVES.items()]:
        assert any(re.fullmatch(rf"  {re.escape(name)} +{re.escape(what)}", line) for line in told), name


@pytest.mark.parametrize("module", RUN)
def test_a_benchmark_has_help(module, monkeypatch, capsys):
    """It prints its options and measures nothing."""
    monkeypatch.setattr(sys, "argv", [module, "--help"])
    monkeypatch.delitem(sys.modules, module, raising=False)
    with pytest.raises(SystemExit) as end:
        runpy.run_module(module, run_name="__main__", alter_sys=False)
    told = capsys.readouterr().out
    assert end.value.code == 0 and told.startswith("usage:") and len(told.splitlines()) > 6


def test_a_benchmark_says_how_it_is_run():
    """By its module's name, also as the main module; its report has the name of `evis bench`."""
    script = [sys.executable, "-m", "bench.measure.disks", "--help"]
    assert subprocess.run(script, capture_output=True, text=True).stdout.startswith(
        "usage: python -m bench.measure.disks"
    )
    assert (
        command.subject_of("bench.graph.runs") == "graph" and command.subject_of("bench.renderer.gpu") == "renderer.gpu"
    )


def measure(quick):
    return {"s": {"title": "T", "command": "c", "rows": [{"a": 1}, {"a": 22, "b": 3}], "note": "n"}}


def test_tables_are_printed_and_a_report_is_written(tmp_path, capsys):
    """The text has a column for what only some rows have; the report is that of `evis bench`."""
    command.run(measure, "about", argv=["--quick", "--out", str(tmp_path / "r.json")])
    assert capsys.readouterr().out.splitlines()[:5] == ["T", "a   b", "1", "22  3", "n"]
    report = json.loads((tmp_path / "r.json").read_text())
    assert report["quick"] and report["machine"]["cores"] and report["date"]
    assert list(report["subjects"].values()) == [measure(True)]


def test_json_is_what_was_measured(capsys):
    command.run(measure, "about", argv=["--json"])
    assert json.loads(capsys.readouterr().out) == measure(False)


def test_a_benchmark_of_a_gpu_takes_no_other_device(capsys):
    with pytest.raises(SystemExit):
        command.run(measure, "about", device="cuda", argv=["--device", "cpu"])
    assert "--device is 'cpu'" in capsys.readouterr().err
