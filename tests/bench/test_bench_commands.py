"""Every benchmark answers --help, and writes a report that others read."""

import json
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from bench import command, documents, event_hashes, gpu_graph
from bench.physics import engines, environments
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


def test_names_and_what_they_measure_stand_apart(capsys):
    """In the help of `evis bench`, the longest name too."""
    main(["bench", "--help"])
    written = [line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines()]
    for name, what in [*((name, what) for name, (_, what) in SUBJECTS.items()), *BY_THEMSELVES.items()]:
        assert [name, what] in written


@pytest.mark.parametrize("module", RUN)
def test_a_benchmark_has_help(module, monkeypatch, capsys):
    """It prints its options and measures nothing."""
    monkeypatch.setattr(sys, "argv", [module, "--help"])
    monkeypatch.delitem(sys.modules, module, raising=False)
    with pytest.raises(SystemExit) as end:
        runpy.run_module(module, run_name="__main__", alter_sys=False)
    told = capsys.readouterr().out
    assert end.value.code == 0 and told.startswith("usage:") and len(told.splitlines()) > 6


def test_a_benchmark_says_how_it_is_run(capsys):
    """By its module's name, also as the main module; its report has the name of `evis bench`."""
    script = [sys.executable, "-m", "bench.measure.disks", "--help"]
    assert subprocess.run(script, capture_output=True, text=True).stdout.startswith(
        "usage: python -m bench.measure.disks"
    )
    for made in (documents, engines, environments, event_hashes):
        with pytest.raises(SystemExit):
            made.main(["--help"])
        assert capsys.readouterr().out.startswith(f"usage: python -m {made.__name__} ")
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


def refused(capsys, main, *words):
    """Gives what a benchmark says that is given these words, which it must refuse before it measures anything."""
    with pytest.raises(SystemExit) as end:
        main(words)
    told = capsys.readouterr()
    assert end.value.code and not told.out
    return told.err.splitlines()[-1] if told.err else str(end.value.code)


def test_a_file_that_cannot_be_written_is_refused_before_anything_is_measured(tmp_path, capsys):
    def fails(*_):
        raise AssertionError("measured")

    def run(words):
        command.run(fails, "about", argv=words)

    gone = tmp_path / "gone"
    assert f"there is no folder {gone}; make it first" in refused(capsys, run, "--out", str(gone / "r.json"))
    assert "is a folder" in refused(capsys, run, "--out", str(tmp_path))
    hashes = ("--scenes", "spinning_disk", "--out", str(gone / "h.json"))
    assert f"there is no folder {gone}" in refused(capsys, event_hashes.main, *hashes)


def test_measuring_nothing_is_a_failure(tmp_path, capsys):
    """Words of rows that no row has leave no report behind."""
    out = tmp_path / "r.json"
    words = ["--rows", "none such", "--sections", "frames", "--out", str(out)]
    run = lambda words: command.run(gpu_graph.measure, "a", device="cpu", argv=words, options=gpu_graph.add_options)
    assert "nothing was measured" in refused(capsys, run, *words) and not out.exists()
    assert "no section 'frame'; did you mean 'frames'?" in refused(capsys, run, "--sections", "frame")
    assert "No such file" in refused(capsys, run, "--add", str(out))
    out.write_text('{"subjects": {}}')
    assert "it has no figures of gpu_graph" in refused(capsys, run, "--add", str(out))
    out.write_text('{"subjects": {"gpu_graph": {"frames": {"title": "Frames, one process, A GPU", "rows": []}}}}')
    assert "it is of 'Frames, one process, A GPU'" in refused(capsys, run, "--add", str(out))


@pytest.mark.parametrize("main, words, why", [
    (engines.main, "--cases -1", "'-1' is not a number of 1 or more"),
    (engines.main, "--device tpu", "--device is 'tpu'; it can be cpu, cuda or cuda:N"),
    (engines.main, "--cases 1", 'MuJoCo Warp: it is not installed; pip install "evis[gpu]" brings it'),
    (environments.main, "robot_arn --envs 2", "did you mean 'robot_arm'?"),
    (environments.main, "spinning_disk --envs 2", "scene spinning_disk has no MuJoCo model"),
    (environments.main, "falling_objects --envs 2,x", "'x' is not a number of 1 or more"),
    (environments.main, "falling_objects --envs ,", "--envs names no number"),
    (environments.main, "falling_objects --keyframes 0", "'0' is not a number of 1 or more"),
    (environments.main, "falling_objects --threads ,", "no engine to measure"),
    (environments.main, "falling_objects --envs 2 --device cpu", "Warp cannot take scene falling_objects: it is not"),
])  # fmt: skip
def test_words_that_mean_nothing_are_refused_in_one_line(main, words, why, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "mujoco_warp", None)  # as where it is not installed
    assert why in refused(capsys, main, *words.split())
