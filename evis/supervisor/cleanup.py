"""Removes a run's directory when its launcher is gone: `python -I -S cleanup.py DIRECTORY`, launcher on stdin.

A launcher that ends in order has removed the directory itself. One that is killed closes its end of the pipe by dying;
its children die with it (evis/runtime/process/parent_death.py), and this small process takes away what they leave.
"""

import os
import shutil
import signal
import sys
import time


def main(directory: str) -> None:
    """Waits for the end of stdin, then removes the directory of a run."""
    for name in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(name, signal.SIG_IGN)
    while os.read(0, 64):
        pass
    # A child that is just dying may still make a file: look again until it stays away.
    for _ in range(5):
        if not os.path.exists(os.path.join(directory, "lock")) and not os.path.isdir(directory):
            return
        shutil.rmtree(directory, ignore_errors=True)
        time.sleep(0.1)


if __name__ == "__main__":
    main(sys.argv[1])
