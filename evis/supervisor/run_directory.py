"""Makes the private directory of a run, for sockets, logs and the plan, which is removed however the run ends."""

from __future__ import annotations

import contextlib
import fcntl
import os
import secrets
import shutil
import stat
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

LOCK = "lock"
"""File in a run's directory that its launcher holds locked: a run without that lock is dead."""
_LONGEST_ROOT = 40
"""Longest root that leaves a socket's path room [characters]; the system's limit is 107."""
_SETTLE_S = 60.0
_CLEANUP_S = 10.0
"""Longest wait for the clean-up process, which has nothing left to do [s]."""


def root() -> Path:
    """Returns the folder of all runs of this user: below XDG_RUNTIME_DIR, or /tmp/evis-<uid>.

    Raises OSError if not private.
    """
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    if runtime and len(runtime) < _LONGEST_ROOT and os.path.isdir(runtime) and os.access(runtime, os.W_OK):
        folder = Path(runtime) / "evis"
    else:
        folder = Path(tempfile.gettempdir()) / f"evis-{os.getuid()}"
        if len(str(folder)) > _LONGEST_ROOT:
            folder = Path("/tmp") / f"evis-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    status = folder.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid():
        raise OSError(f"{folder} belongs to somebody else; set XDG_RUNTIME_DIR to a folder of your own")
    if stat.S_IMODE(status.st_mode) != 0o700:
        folder.chmod(0o700)
    return folder


@contextlib.contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Names the folder and the remedy in errors of writing, which the system's own do not."""
    try:
        yield
    except OSError as error:
        reason = f"{error.strerror or error}; make room there, or set XDG_RUNTIME_DIR to another folder of your own"
        raise OSError(error.errno, reason, error.filename or str(folder)) from None


def is_live(directory: Path) -> bool:
    """Tells whether the launcher of this run is alive."""
    try:
        with open(directory / LOCK) as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                return True
    except OSError:
        pass
    return False


def live_runs() -> list[Path]:
    """Lists the directories of running graphs, the newest first."""
    begun: list[tuple[int, Path]] = []
    with contextlib.suppress(OSError):
        for folder in root().iterdir():
            # Those of one second have names in any order. A run that ends just now has no plan.
            with contextlib.suppress(OSError):
                since = (folder / "plan.json").stat().st_mtime_ns
                if is_live(folder):
                    begun.append((since, folder))
    return [folder for _, folder in sorted(begun, reverse=True)]


def sweep() -> list[Path]:
    """Removes what dead runs have left, and returns their names."""
    removed = []
    for folder in root().iterdir():
        try:
            young = time.time() - folder.stat().st_mtime < _SETTLE_S
        except OSError:
            continue
        # A run that is just being made has no lock yet.
        if folder.is_dir() and not is_live(folder) and ((folder / LOCK).exists() or not young):
            shutil.rmtree(folder, ignore_errors=True)
            removed.append(folder)
    return removed


class RunDirectory:
    """Owns a run's directory, locked by this process; a clean-up process watches it and outlives this one for a
    moment."""

    def __init__(self) -> None:
        """Makes the directory. Raises OSError, and leaves nothing then, where there is no room for it or for the
        process that watches it."""
        sweep()
        self.run_id = f"{time.strftime('%Y%m%d-%H%M%S')}-{secrets.token_hex(3)}"
        self.path = root() / self.run_id
        with contextlib.ExitStack() as undo:
            with writing(self.path):
                self.path.mkdir(mode=0o700)
                undo.callback(shutil.rmtree, self.path, ignore_errors=True)
                # Locked before it has its name: another launcher sweeps what has a lock file that nobody holds.
                unnamed = self.path / f"{LOCK}.new"
                self._lock = undo.enter_context(open(unnamed, "w"))
                fcntl.flock(self._lock, fcntl.LOCK_EX)
                unnamed.rename(self.path / LOCK)
            self._cleanup = subprocess.Popen(
                [sys.executable, "-I", "-S", str(Path(__file__).with_name("cleanup.py")), str(self.path)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
            undo.pop_all()

    def close(self) -> None:
        """Removes the directory and ends the clean-up process."""
        shutil.rmtree(self.path, ignore_errors=True)
        self._lock.close()
        if self._cleanup.stdin is not None:
            with contextlib.suppress(OSError):
                self._cleanup.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):  # stopped, or on a busy machine: it ends by itself
            self._cleanup.wait(_CLEANUP_S)
