"""A bag of every kind of message, and the command line on it."""

import contextlib
import io

from bag_messages import scene

from evis.bag.writer import BagWriter
from evis.cli import main

KEYFRAMES = 5


def bag(path, envs=1, margin=0):
    with BagWriter(path, {"evis": {"seed": "7"}}) as writer:
        for k in range(KEYFRAMES):
            for topic, message in scene(k, envs).items():
                if hasattr(message, "margin"):
                    message.margin = margin
                writer.write(topic, message)
    return path


def run(*words):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            status = main(list(words))
        except SystemExit as exit_:
            status = exit_.code
    return status, out.getvalue(), err.getvalue()
