"""Reads damaged files one after the other, with a limit of memory: `python reader_child.py FOLDER`.

A job is a line of JSON on stdin: subject, file, other, seed (none: it is left whole), place (the path to put it, beside
what it belongs to). Per job a line on stdout: the kind of damage, and what came of it: `read`, `refused`, or what
should not have been.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import resource
import sys
from collections.abc import Callable
from pathlib import Path

from mutations import mutate

LIMIT = int(os.environ.get("EVIS_ADVERSARY_MEMORY", str(3 << 30)))
"""Address space of the child [bytes]; its code and libraries take 1 GB of it."""


def refused(path: Path, error: BaseException) -> str:
    """How an error of the right type ended: in one line that names the file, or not."""
    text = str(error)
    if "\n" in text:
        return f"an error of several lines: {text!r:.300}"
    return "refused" if path.name in text or path.stem in text else f"the file is not named: {text!r:.300}"


def command(path: Path, *words: str) -> str:
    """`evis WORDS` in this process."""
    from evis.cli import main

    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            status = main(list(words))
        except SystemExit as end:
            status = int(end.code or 0)
    lines = [line for line in err.getvalue().splitlines() if line]
    if status == 0:
        return "read"
    # A launch file may come to ask for an argument, which is wrong usage.
    if status in ((1, 2) if words[0] == "launch" else (1,)) and len(lines) == 1 and "--debug shows" not in lines[0]:
        return refused(path, ValueError(lines[0]))
    return f"evis {words[0]} {words[1]}: status {status}, {err.getvalue()!r:.400}"


def recording(path: Path, seed: int) -> str:
    """Opened and read; then by one of the commands."""
    from evis.events import RecordingError, open_recording

    try:
        with open_recording(path) as recording:
            for block in recording.blocks():
                info = recording.info
                if len(block) and not (block.x.max() < info.width and block.y.max() < info.height):
                    return f"an event beyond {info.width} x {info.height}"
        result = "read"
    except RecordingError as error:
        result = refused(path, error)
    if result not in ("read", "refused"):
        return result
    target = path.with_name("converted.npz")
    words = [("events", "info"), ("events", "convert"), ("events", "measure", "--no-rotation")][seed % 3]
    try:
        told = command(path, *words[:2], str(path), *([str(target)] if "convert" in words else words[2:]))
    finally:
        target.unlink(missing_ok=True)
    return told if told != "read" else result


def scene(path: Path, seed: int) -> str:
    """A scene, or what a scene beside it is made of."""
    from evis.config.params import ParamError
    from evis.scene import SceneError, load_scene

    whole = path if path.suffix in (".yaml", ".xml", ".urdf") else path.with_name("scene.yaml")
    try:
        load_scene(str(whole))
        return "read"
    except (SceneError, ParamError, FileNotFoundError) as error:
        return refused(whole, error) if "the file is not" in refused(path, error) else refused(path, error)


def launch(path: Path, seed: int) -> str:
    """Planned."""
    return command(path, "launch", str(path), "--explain")


def bag(path: Path, seed: int) -> str:
    """Described, repaired or exported."""
    target = path.with_name(f"target{'.npz' if seed % 3 == 2 else '.mcap'}")
    words = [("info",), ("recover",), ("export", "--topic", "/cam0/events")][seed % 3]
    try:
        return command(path, "bag", words[0], str(path), *words[1:], *([] if seed % 3 == 0 else [str(target)]))
    finally:
        for left in path.parent.glob("target*"):
            left.unlink()


SUBJECTS: dict[str, Callable[[Path, int], str]] = {"recording": recording, "scene": scene, "launch": launch, "bag": bag}


def main() -> None:
    """Until stdin ends."""
    resource.setrlimit(resource.RLIMIT_AS, (LIMIT, LIMIT))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # what libraries print is no answer
    for line in sys.stdin:
        job = json.loads(line)
        place = Path(job["place"])
        other = Path(job["other"]).read_bytes() if job["other"] else b""
        whole = Path(job["file"]).read_bytes()
        data, kind = mutate(whole, job["seed"], other) if job["seed"] else (whole, "none")
        place.write_bytes(data)
        try:
            result = SUBJECTS[job["subject"]](place, sum(job["seed"][-1:]))
        except BaseException as error:
            result = f"{type(error).__name__}: {str(error)!r:.300}"
        answers.write(json.dumps([kind, result]) + "\n")


if __name__ == "__main__":
    main()
