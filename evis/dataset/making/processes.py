"""Runs workers as processes of this machine."""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from typing import IO, Any

from evis.dataset.making.tasks import Answer
from evis.dataset.recipe import Plan
from evis.supervisor.node_process import environment_of_child

PATIENCE_S = 5.0
"""Longest wait for the end of a worker that has nothing to do [s]."""


@dataclass
class _Process:
    """One worker. indices: of the sequences that it makes. log: what it prints."""

    process: subprocess.Popen[bytes]
    log: IO[bytes]
    indices: Sequence[int] = ()


class Processes:
    """Runs workers as processes, and tells of one that dies how it died."""

    def __init__(self, count: int, out: str, gpus: int = 0) -> None:
        """gpus: where above 0, worker i sees GPU i % gpus alone."""
        self.count = count
        self._out, self._gpus = out, gpus
        self._all: dict[int, _Process] = {}
        self._selector = selectors.DefaultSelector()

    def assign(self, worker: int, plans: Sequence[Plan]) -> None:
        """Gives a worker its next plans; starts it where there is none."""
        if worker not in self._all:
            self._start(worker)
        known = self._all[worker]
        known.indices = [plan.index for plan in plans]
        assert known.process.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # its end is noticed where answers are read
            known.process.stdin.write(json.dumps([plan.as_dict() for plan in plans]).encode() + b"\n")
            known.process.stdin.flush()

    def wait(self, timeout_s: float) -> Sequence[Answer]:
        """Waits for answers."""
        answers = []
        for key, _ in self._selector.select(timeout_s):
            worker = key.data
            known = self._all[worker]
            line = known.process.stdout.readline() if known.process.stdout else b""
            if line.endswith(b"\n"):
                answers += [Answer(worker, **told) for told in json.loads(line)]
                known.indices = ()
            else:
                answers += self._ended(worker)
        return answers

    def _start(self, worker: int) -> None:
        environment = environment_of_child()
        if self._gpus:
            seen = os.environ.get("CUDA_VISIBLE_DEVICES", "").split(",")
            gpu = worker % self._gpus
            environment["CUDA_VISIBLE_DEVICES"] = seen[gpu] if gpu < len(seen) and seen[gpu] else str(gpu)
        log: Any = tempfile.TemporaryFile()
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "evis.dataset.making.process", self._out],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            start_new_session=True,
            env=environment,
        )
        self._all[worker] = _Process(process, log)
        self._selector.register(process.stdout, selectors.EVENT_READ, worker)  # type: ignore[arg-type]

    def _ended(self, worker: int) -> list[Answer]:
        """What is said of a worker that has died."""
        known = self._all.pop(worker)
        self._selector.unregister(known.process.stdout)  # type: ignore[arg-type]
        status = known.process.wait()
        known.log.seek(0, os.SEEK_END)
        known.log.seek(max(0, known.log.tell() - 1000))
        words = known.log.read().decode(errors="replace").strip().splitlines()[-1:]
        self._release(known)
        if not known.indices:
            return []
        if status == -signal.SIGKILL:
            cause = "the worker was killed; if nobody did that by hand, the machine ran out of memory: fewer --workers"
        elif status < 0:
            cause = f"the worker was ended by {signal.Signals(-status).name}"
        else:
            cause = f"the worker ended with exit status {status}: {' '.join(words) or 'no message'}"
        return [Answer(worker, index, cause=cause, died=True) for index in known.indices]

    def close(self) -> None:
        """Ends all workers; what one is making is broken off, and nothing of it stays."""
        for known in self._all.values():
            if known.indices:
                known.process.kill()
            elif known.process.stdin is not None:
                known.process.stdin.close()
        for known in self._all.values():
            try:
                known.process.wait(PATIENCE_S)
            except subprocess.TimeoutExpired:
                known.process.kill()
                known.process.wait()
            self._release(known)
        self._all.clear()
        self._selector.close()

    @staticmethod
    def _release(known: _Process) -> None:
        known.log.close()
        for pipe in (known.process.stdin, known.process.stdout):
            if pipe is not None:
                with contextlib.suppress(BrokenPipeError):
                    pipe.close()
