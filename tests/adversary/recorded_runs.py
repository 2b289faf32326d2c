"""A recorded run to attack, the undisturbed one to hold it against, and what must be true of what is left.

The events of a bag are read by the MCAP library alone: the bytes of each message of the event topic, in order.
"""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import shlex
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import psutil
import pytest
from launcher import LIMIT_S, Launcher
from mcap.reader import make_reader

from evis.bag.reader import BagReader
from evis.bag.recover import recover
from evis.cli.graph.attach import find_run, listen
from evis.runtime.plan import Plan

TOPIC = "/cam0/events"
DURATION_S = 2.0
WORDS = ("spinning_disk", "width:=96", "height:=72", "keyframe_rate:=100", "upsampling:=2", "omega:=30",
         "threshold_mismatch:=0.03", "shot_rate:=2", "--seed", "5", "--duration", str(DURATION_S))  # fmt: skip
HOW: dict[str, tuple[str, ...]] = {"as processes": (), "composed": ("--compose",), "split": ("--split",)}
CHUNK_S = 0.1
"""What a bag holds back at most before it is in the file."""


@dataclass
class Found:
    """Events of a bag: (stamp, bytes) of each message, and whether it was whole as it lay there."""

    messages: list[tuple[int, bytes]]
    torn: str = ""

    @property
    def hash(self) -> str:
        """Of all that is in it."""
        return prefix_hashes(self.messages)[-1]


def prefix_hashes(messages: list[tuple[int, bytes]]) -> list[str]:
    """Hash of the first 0, 1, 2, ... messages."""
    sha = hashlib.sha256()
    hashes = [sha.hexdigest()]
    for stamp, data in messages:
        sha.update(stamp.to_bytes(8, "little") + len(data).to_bytes(8, "little") + data)
        hashes.append(sha.hexdigest())
    return hashes


def read_events(path: Path) -> list[tuple[int, bytes]]:
    """By the MCAP library, every checksum looked at."""
    with open(path, "rb") as file:
        messages = make_reader(file, validate_crcs=True).iter_messages(topics=[TOPIC], log_time_order=False)
        return [(message.log_time, message.data) for _, _, message in messages]


def opened(path: Path) -> Found:
    """What a bag holds after any kind of end; a torn one is recovered first, elsewhere."""
    with BagReader(path) as reader:
        torn = reader.problem
    if not torn:
        return Found(read_events(path))
    with tempfile.TemporaryDirectory(prefix="evr", dir="/tmp") as folder:  # its own disk may be full
        saved = Path(folder) / "saved.mcap"
        recover(path, saved)
        return Found(read_events(saved), torn)


class ShellLauncher(Launcher):
    """The same command before a redirection or a pipe, in a shell."""

    def __init__(self, path: Path, *words: str, end: str) -> None:
        command = shlex.join([sys.executable, "-m", "evis", "launch", str(path), *words])
        self.process = subprocess.Popen(
            ["bash", "-c", f"{command} {end}"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        self.seen = []


class Watcher:
    """Listens to the events of the only running graph, as a viewer does: what has been published for certain."""

    def __init__(self) -> None:
        self.newest = -1
        """Stamp of the newest message seen [ns]; -1 before the first."""
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._done.is_set():
            with contextlib.suppress(ValueError, OSError):
                for _, message, _ in listen(find_run(None), TOPIC):
                    self.newest = max(self.newest, message.header.stamp_ns)
                    if self._done.is_set():
                        return
            time.sleep(0.02)

    def stop(self) -> None:
        """No graph runs any more, or nobody cares."""
        self._done.set()
        self._thread.join(LIMIT_S)


@dataclass
class Stage:
    """A folder to record in, a runtime directory and a folder for temporary files that nobody else uses."""

    folder: Path
    runtime: Path
    temporary: Path
    reference: list[tuple[int, bytes]] = field(default_factory=list)
    wall_s: dict[str, float] = field(default_factory=dict)
    launchers: list[Launcher] = field(default_factory=list)

    @classmethod
    @contextlib.contextmanager
    def made(cls, folder: Path) -> Iterator[Stage]:
        """Struck at the end: no process outlives it."""
        with pytest.MonkeyPatch.context() as patch, contextlib.ExitStack() as stack:
            # Short, because a socket's path is limited.
            runtime, temporary = (
                Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="ev", dir="/tmp"))) for _ in range(2)
            )
            patch.setenv("XDG_RUNTIME_DIR", str(runtime))
            patch.setenv("TMPDIR", str(temporary))
            stage = cls(folder, runtime, temporary)
            try:
                yield stage
            finally:
                stage.strike()

    def strike(self) -> None:
        """Kill what is left of all runs."""
        for launcher in self.launchers:
            launcher.stop()
            for process in launcher.survivors(0):
                with contextlib.suppress(psutil.NoSuchProcess):
                    process.kill()

    @property
    def bag(self) -> Path:
        """The same name for every run: what one leaves must not stop the next."""
        return self.folder / "run.mcap"

    def launch(self, how: str, pace: str = "realtime", *words: str) -> Launcher:
        """Start the run that all campaigns attack."""
        return self.start(*WORDS, f"pace:={pace}", *words, how=how)

    def start(self, name: str, *words: str, how: str) -> Launcher:
        """Start any recorded graph."""
        return self._watched(Launcher(Path(name), *words, "--record", str(self.bag), *HOW[how]))

    def shell(self, end: str) -> Launcher:
        """Start the run that all campaigns attack in a shell, with what follows the command there."""
        return self._watched(
            ShellLauncher(Path(WORDS[0]), *WORDS[1:], "pace:=realtime", "--record", str(self.bag), end=end)
        )

    def under_way(self, launcher: Launcher) -> dict[str, psutil.Process]:
        """Wait until it records events, and return its processes; none where it has ended before that."""
        launcher.wait_for(
            lambda: (self.bag.exists() and self.bag.stat().st_size > 100_000) or launcher.process.poll() is not None
        )
        return running_processes(launcher)

    def _watched(self, launcher: Launcher) -> Launcher:
        self.launchers.append(launcher)
        return launcher

    def undisturbed(self, how: str, pace: str = "realtime", *words: str) -> Found:
        """Run to the end; its wall time is known from then on."""
        begun = time.monotonic()
        code, _, err = self.launch(how, pace, *words).end()
        assert code == 0, err
        self.wall_s[how] = time.monotonic() - begun
        return opened(self.bag)

    def is_prefix(self, messages: list[tuple[int, bytes]]) -> bool:
        """Byte by byte the beginning of the undisturbed run."""
        if len(messages) > len(self.reference):
            return False
        return prefix_hashes(messages)[-1] == prefix_hashes(self.reference)[len(messages)]

    def nothing_left(self, launcher: Launcher) -> list[str]:
        """What a run has left behind that it should not have; a moment is granted."""
        left = [f"process {p.pid} lives on" for p in launcher.survivors()]
        end = time.monotonic() + LIMIT_S
        while (files := self._files()) and time.monotonic() < end:
            time.sleep(0.05)
        return left + files

    def _files(self) -> list[str]:
        return [str(p) for p in itertools.chain(self.runtime.glob("evis/*"), self.temporary.iterdir())]

    def clear(self) -> None:
        """Older bags that the runs have put aside; the newest stays, for the next run to find."""
        for path in self.folder.glob("run.mcap.bak*"):
            path.unlink()


def kill(alive: dict[str, psutil.Process], name: str) -> None:
    """SIGKILL, if there is such a process any more."""
    with contextlib.suppress(psutil.NoSuchProcess, KeyError):
        alive[name].kill()


def process_of(plan: Plan, node: str) -> str:
    """The name of the process in which a node runs."""
    return next(planned.process for planned in plan.nodes.values() if planned.name == node)


def running_processes(launcher: Launcher) -> dict[str, psutil.Process]:
    """Every process of the run that lives now: the launcher, its janitor, the nodes' processes by name."""
    found = {}
    nodes = launcher.children()
    with contextlib.suppress(psutil.NoSuchProcess):
        found["launcher"] = psutil.Process(launcher.process.pid)
    for process in launcher.seen:
        with contextlib.suppress(psutil.Error):
            if process.is_running() and process.status() != psutil.STATUS_ZOMBIE:
                found[process.cmdline()[-1] if process in nodes else "janitor"] = process
    return found


def named_shared_memory(process: psutil.Process) -> list[str]:
    """Files in /dev/shm that a process maps: they would outlive it."""
    try:
        text = Path(f"/proc/{process.pid}/maps").read_text()
    except OSError:
        return []
    return [line for line in text.splitlines() if "/dev/shm/" in line]
