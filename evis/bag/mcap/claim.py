"""Opens the file that a bag is recorded to; an older one of its name is moved aside and never lost."""

from __future__ import annotations

import errno
import fcntl
import itertools
import os
import stat
from pathlib import Path

from evis.bag import BagError
from evis.bag.mcap.path_checks import check_name, refusal
from evis.bag.mcap.scan import Scanner
from evis.files.named_pipe import with_reader
from evis.files.whole_file import written_at


def claim(path: Path) -> tuple[int, Path | None]:
    """Opens a new file at `path`, and returns its descriptor and the place of an older one (None where there was none).

    The old file becomes `<name>.bak`, or `<name>.bak2`, ... where there is such a one already, and has its name again
    where the new one cannot be made. A bag without any message, as a run leaves that failed at its start, is not kept.
    A symbolic link stays: what it leads to is written, and put aside there. Raises BagError, also for a bag that
    another process still records. Who may read the bag is what the user's umask says.
    """
    check_name(path)
    name, path = path, written_at(path)
    try:
        if path.is_symlink():
            raise BagError(f"cannot record to {name}: the link leads to itself")
        mode = _mode_of(path)
        if mode and not stat.S_ISREG(mode):
            if stat.S_ISDIR(mode):
                raise BagError(f"cannot record to {name}: it is a folder; name a file such as {name / 'a.mcap'}")
            with with_reader(path):
                return os.open(path, os.O_WRONLY | os.O_CLOEXEC), None
        return _new_file(path)
    except FileNotFoundError as error:
        if path.parent.is_dir():
            raise BagError(f"cannot record to {name}: {path.parent} takes no files ({error.strerror})") from None
        raise BagError(f"cannot record to {name}: there is no directory {path.parent}; create it first") from None
    except OSError as error:
        why = refusal(path.parent) if error.errno in (errno.EACCES, errno.EPERM, errno.EROFS) else error.strerror
        raise BagError(f"cannot record to {name}: {why}") from None


def _mode_of(path: Path) -> int:
    """Gives the mode of a file, 0 where there is none: asked once, for another may put it aside at any time."""
    try:
        return path.stat().st_mode
    except FileNotFoundError:
        return 0


def _new_file(path: Path) -> tuple[int, Path | None]:
    """Makes and locks the file, after an older one has been put aside.

    Only who holds the lock of a file takes it from its name, so that of several that come at once one gets the name.
    """
    backup: Path | None = None
    while True:
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        except FileExistsError:
            backup = _put_aside(path) or backup
            continue
        except OSError:
            if backup:
                backup.rename(path)
            raise
        held = False
        try:
            held = _locked(descriptor, path)
        except OSError:  # a file system without locks
            path.unlink()
            raise
        finally:
            if not held:
                os.close(descriptor)
        if held:
            return descriptor, backup


def _put_aside(path: Path) -> Path | None:
    """Moves a file out of the way of a new one, and returns its new place; None for a bag without messages, which goes,
    and for a file that another has taken away meanwhile."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        return None
    try:
        if not _locked(descriptor, path):
            return None
        if _is_empty_bag(descriptor, path):
            path.unlink()
            return None
        backup = _free_name(path)
        path.rename(backup)
        return backup
    finally:
        os.close(descriptor)


def _locked(descriptor: int, path: Path) -> bool:
    """Locks an open file, as a recorder does while it records; False where it has lost its name before that.

    Raises BagError where another holds the lock.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise BagError(f"cannot record to {path}: another run is recording to it; name another file") from None
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False


def _free_name(path: Path) -> Path:
    names = (path.with_name(f"{path.name}.bak{number if number > 1 else ''}") for number in itertools.count(1))
    return next(name for name in names if not name.exists())


def _is_empty_bag(descriptor: int, path: Path) -> bool:
    """Tells whether a file is empty, or a whole bag without messages."""
    try:
        if not os.fstat(descriptor).st_size:
            return True
        layout = Scanner(descriptor, str(path)).layout
        return not layout.problem and not layout.chunks
    except BagError:
        return False  # of another kind, or torn
