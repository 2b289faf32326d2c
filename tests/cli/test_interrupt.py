"""Ctrl-C at any moment: exit status 130 or an orderly end, and never a traceback."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command import environment

LIMIT_S = 120.0
STARTS = """
import os, signal, sys
sys.argv = ["evis", {words}]
signal.signal(signal.SIGINT, signal.default_int_handler)  # in the background of a shell it would be ignored
seen = 0

def trace(frame, event, argument):
    global seen
    if event == "call" and {begun}:
        seen += 1
        if seen == {moment}:
            for name in {names}:
                os.kill(os.getpid(), getattr(signal, name))
    return None

sys.path.insert(0, {folder!r})
sys.settrace(trace)
from evis.cli import main
sys.exit(main())
"""
"""The program with signals at the so-many-th call of a function since it has `begun`, wherever that is."""


def explained(
    begun: str, names: list[str], moment: int, runtime: Path, folder: Path
) -> subprocess.CompletedProcess[str]:
    """Runs `evis launch spinning_disk --explain`, which gets the signals of these names."""
    root = str(Path(__file__).parents[2])
    words = "'launch', 'spinning_disk', '--explain'"
    code = STARTS.format(words=words, begun=begun, names=names, moment=moment, folder=root)
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=folder, env=environment(runtime),
        timeout=LIMIT_S,
    )  # fmt: skip


@pytest.mark.parametrize("moment", [1, 2, 3, 10, 40, 150, 400, 1000, 2500, 6000])
def test_ctrl_c_at_the_so_many_th_call_from_the_first_line_on(
    moment: int, runtime_folder: Path, tmp_path: Path
) -> None:
    done = explained("sys.excepthook is not sys.__excepthook__", ["SIGINT"], moment, runtime_folder, tmp_path)
    assert done.returncode == 130, done.stderr
    assert done.stderr in ("evis: interrupted\n", "evis launch: interrupted\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("moment", [3, 40, 400, 2500])
def test_sigterm_ends_as_ctrl_c_does(moment: int, runtime_folder: Path, tmp_path: Path) -> None:
    """It ended the program where it was, whatever that was writing. Twice at once, as `timeout` sends it, is once."""
    done = explained("callable(signal.getsignal(signal.SIGTERM))", ["SIGTERM"] * 2, moment, runtime_folder, tmp_path)
    assert done.returncode == 143, done.stderr
    assert done.stderr in ("evis: interrupted\n", "evis launch: interrupted\n")


@pytest.mark.slow
def test_ctrl_c_after_many_delays(runtime_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "graph.yaml").write_text(
        "nodes: {ticker: {type: 'graph_nodes:Ticker', keep: [depth], params: {count: 0, sleep: 0.01}}}\n"
    )
    for step in range(60):
        process = subprocess.Popen(
            [sys.executable, "-m", "evis", "launch", "graph.yaml"],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path, env=environment(runtime_folder),
        )  # fmt: skip
        time.sleep(0.15 + 0.03 * step)
        process.send_signal(signal.SIGINT)
        _, told = process.communicate(timeout=LIMIT_S)
        # Before the first line of evis Python itself answers, as it does for every program.
        early = process.returncode == -signal.SIGINT and "/evis/" not in told
        assert early or (process.returncode in (0, 130) and "Traceback" not in told), (step, told)


def test_ctrl_c_in_a_finalizer_is_not_forgotten() -> None:
    code = (
        "import signal, sys; sys.argv = ['evis']\nimport evis, time\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "class A:\n    def __del__(self): raise KeyboardInterrupt\n"
        "A()\ntime.sleep(60)"
    )
    root = str(Path(__file__).parents[2])
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=50, cwd=root)
    assert done.returncode == 130 and done.stderr == "evis: interrupted\n"


def test_a_library_user_keeps_pythons_ways() -> None:
    code = "import sys; before = sys.excepthook, sys.unraisablehook; import evis.cli\n"
    code += "assert (sys.excepthook, sys.unraisablehook) == before"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(__file__).parents[2])


def test_a_signal_gives_its_status() -> None:
    from evis.cli.failure import guarded

    def ended(number: int) -> int:
        raise KeyboardInterrupt(number)

    assert guarded("evis", False, lambda: ended(signal.SIGTERM)) == 143
