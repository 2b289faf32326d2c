"""SIGTERM: at the next place where nothing is half done, and after a moment anywhere."""

from __future__ import annotations

import subprocess
import sys

START = """
import os, signal, time
from evis.console import termination
from evis.console.termination import Termination
t = Termination()
"""


def status(code: str) -> tuple[int, str]:
    done = subprocess.run([sys.executable, "-c", START + code], capture_output=True, text=True, timeout=60)
    return done.returncode, done.stdout.strip()


def test_what_is_half_done_is_finished_first() -> None:
    code = (
        "termination.GRACE_S = 60\n"
        "os.kill(os.getpid(), signal.SIGTERM)\n"
        "pins = 1\npins -= 1\nprint(pins, t.asked)\n"
        "os.kill(os.getpid(), signal.SIGTERM)\n"
        "t.check()\nprint('too far')"
    )
    assert status(code) == (143, "0 True")


def test_nothing_is_raised_before_the_signal_or_a_second_time() -> None:
    code = (
        "t.check()\nos.kill(os.getpid(), signal.SIGTERM)\n"
        "try: t.check()\n"
        "except SystemExit: print('once')\n"
        "t.check()\nos.kill(os.getpid(), signal.SIGTERM)\ntime.sleep(2 * termination.GRACE_S)\nprint('closed')"
    )
    assert status(code) == (0, "once\nclosed")


def test_what_never_comes_to_such_a_place_is_ended_where_it_is() -> None:
    assert status("os.kill(os.getpid(), signal.SIGTERM)\ntime.sleep(50)\nprint('too far')") == (143, "")
