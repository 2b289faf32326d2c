"""Runs a worker's process: `python -m evis.dataset.making.process OUT` reads lists of plans, and answers each in a
line."""

from __future__ import annotations

import json
import os
import signal
import sys
from typing import Any

from evis.runtime.process.parent_death import die_with_parent


def main(out: str) -> int:
    """Makes the sequences that standard input asks for, until it ends."""
    die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal's Ctrl-C is the parent's to handle
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # what libraries print shall not stand between the answers
    from evis.dataset.making.tasks import Answerer

    answerer = Answerer(out)
    for line in sys.stdin:
        told: list[dict[str, Any]] = answerer.answers(json.loads(line))
        answers.write(json.dumps(told) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
