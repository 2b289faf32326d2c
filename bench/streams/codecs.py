"""Measures the decoding speed of event streams: Warp kernels, their numpy twins, and other libraries on the same files.

    evis bench streams [--quick]

Other libraries may live in another Python: `EVIS_PEERS_PYTHON=/path/to/venv/bin/python evis bench streams`.
"""

from __future__ import annotations

import functools
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from bench import command
from bench.streams import peers as stream_peers
from evis.events import Events, Recording, open_recording, open_writer
from evis.events.codecs.decoder import CODECS, Decoder, decoder_for
from evis.events.codecs.encoder import encoder_for
from evis.events.files.prophesee.raw_header import read_header

WORDS = (
    "evt3",
    "evt2",
    "evt21",
    "evt4",
    "davis346",
    "dvxplorer",
    "dvxplorer_mini",
    "dvs128",
    "libcaer",
    "libcaer_cmp",
    "mono",
)
SIZES = {"davis346": (346, 260), "dvs128": (128, 128), "dvxplorer": (640, 480), "dvxplorer_mini": (640, 480)}
REAL = {
    "real VGA EVT3": ("derived/gen31_vga_from_bag1.raw", "evt3", 640, 480),
    "real VGA EVT2": ("prophesee/faery_evt2.raw", "evt2", 640, 480),
    "real DAVIS AEDAT4": ("aedat4/aestream_davis.aedat4", "aedat4", 346, 260),
}
COMMAND = "evis bench streams"


def data_folder() -> Path:
    """Returns the folder of real recordings, which need not exist."""
    return Path(os.environ.get("EVIS_TEST_DATA", Path(__file__).parents[3] / "shared" / "data"))


def synthetic(n: int, width: int = 1280, height: int = 720) -> Events:
    """Makes rows of neighbouring pixels that fire together, as an edge does: about 8 events per row and time."""
    rng = np.random.default_rng(1)
    groups = n // 8
    t = np.repeat(np.cumsum(rng.integers(0, 3, groups)), 8) * 1000
    x = np.repeat(rng.integers(0, width // 32, groups) * 32, 8) + np.tile(np.arange(0, 32, 4), groups)
    y = np.repeat(rng.integers(0, height, groups), 8)
    return Events.of(t, x, y, np.repeat(rng.integers(0, 2, groups), 8))


def fit(events: Events, encoding: str) -> Events:
    """Folds events into the sensor of an encoding, in the order of its readout."""
    width, height = SIZES.get(encoding, (1280, 720))
    folded = Events(events.t, events.x % width, events.y % height, events.p)
    if not encoding.startswith("dvxplorer"):
        return folded
    # readouts go by column: edges stand upright there
    folded = Events(events.t, folded.y % width, folded.x % height, folded.p)
    return folded[np.lexsort((folded.y, folded.p, folded.y >> 3, folded.x, folded.t))]


def cpu_seconds(work: Callable[[], Any], repeats: int) -> float:
    """Measures the least CPU time [s] of a call, after one that is not counted (imports, compilation)."""
    work()
    times = []
    for _ in range(repeats):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return max(min(times), 1e-9)


def rate(events: int, seconds: float) -> float:
    """Computes million events per second."""
    return round(events / seconds / 1e6, 1)


def decode(decoder: Decoder, packets: list[tuple[int, bytes]]) -> int:
    """Decodes a stream from its start and counts its events."""
    decoder.reset()
    return sum(len(decoder.decode_packet(data, base)) for base, data in packets)


def real_words(name: str) -> bytes | None:
    """Reads the words of a real recording, if there is one."""
    path = data_folder() / REAL[name][0]
    if not path.exists():
        return None
    with path.open("rb") as file:
        read_header(file)
        return file.read()


def codec_rows(quick: bool) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Measures decoding and encoding, a row per stream."""
    repeats, n = (3, 200_000) if quick else (7, 2_000_000)
    events = synthetic(n)
    streams: list[tuple[str, str, tuple[int, int], list[tuple[int, bytes]]]] = []
    encoding_rows = []
    for name in ("real VGA EVT3", "real VGA EVT2"):
        if data := real_words(name):
            streams.append((name, REAL[name][1], (640, 480), [(0, data)]))
    for encoding in WORDS:
        own = fit(events, encoding)
        seconds = cpu_seconds(lambda: encoder_for(encoding).encode_packets(own), 2)  # noqa: B023 (called at once)
        packets = encoder_for(encoding).encode_packets(own)
        encoding_rows.append({"encoder": encoding, "Mev/s": rate(len(own), seconds)})
        streams.append((f"synthetic {encoding}", encoding, SIZES.get(encoding, (1280, 720)), packets))
    rows = []
    for name, encoding, size, packets in streams:
        one, other = (decoder_for(encoding, *size, backend) for backend in ("numpy", "warp"))
        count = decode(one, packets)
        row: dict[str, Any] = {"stream": name, "events": count}
        row["bytes per event"] = round(sum(len(data) for _, data in packets) / count, 2)
        row["numpy Mev/s"] = rate(count, cpu_seconds(functools.partial(decode, one, packets), repeats))
        if other.kernel:
            row["warp Mev/s"] = rate(count, cpu_seconds(functools.partial(decode, other, packets), repeats))
            row["warp / numpy"] = round(row["warp Mev/s"] / row["numpy Mev/s"], 1)
        rows.append(row)
    return rows, encoding_rows


def stepping_back(events: Events) -> Events:
    """Moves one event in a hundred some us back in time, as a sensor's arbiter does now and then."""
    rng = np.random.default_rng(2)
    t = events.t.copy()
    heads = np.arange(0, len(t) - 8, 800)
    # a whole row moves, within its TIME_HIGH
    back = np.minimum(rng.integers(1, 9, len(heads)) * 1000, t[heads] % 4_096_000)
    t[heads[:, None] + np.arange(8)] -= back[:, None]
    return Events(t, events.x, events.y, events.p)


def compared_files(folder: Path, quick: bool) -> list[dict[str, Any]]:
    """Lists files that several libraries read, with the hash of what is in them."""
    files = []
    path = data_folder() / "ground_truth.json"
    truth = json.loads(path.read_text())["files"] if path.exists() else {}
    for name, (relative, form, width, height) in REAL.items():
        if relative in truth and (data_folder() / relative).exists():
            known = truth[relative]["sha256"]
            files.append({"name": name, "path": str(data_folder() / relative), "form": form, "sha256": known})
            files[-1] |= {"width": width, "height": height}
    events = synthetic(200_000 if quick else 2_000_000)
    for form, name, own in (
        ("evt3", "synthetic HD EVT3", events),
        ("evt3", "synthetic HD EVT3, times that step back", stepping_back(events)),
        ("evt2", "synthetic HD EVT2", events),
    ):
        target = folder / f"{len(files)}.raw"
        with open_writer(target, 1280, 720, form) as writer:
            writer.write(own)
        known = stream_peers.digest(own.t // 1000, own.x, own.y, own.p)["sha256"]
        files.append({"name": name, "path": str(target), "form": form, "sha256": known, "width": 1280, "height": 720})
    return files


def ours(path: str, backend: str) -> tuple[Any, Any, Any, Any]:
    """Reads a whole file as every other recording is read."""
    recording: Recording = open_recording(path, backend)
    with recording:
        events = recording.read()
    return events.t // 1000, events.x, events.y, events.p


def verdict(known: str, found: dict[str, Any]) -> str:
    """Tells whether decoded arrays are equal to what is in the file."""
    if found["sha256"] == known:
        return "right"
    return "clamps or changes times" if not found["back"] else f"wrong (last time {found['last_us']} us)"


def reader_rows(quick: bool) -> tuple[list[dict[str, Any]], str]:
    """Measures reading files into arrays by every library that is there, in one run; and says which are absent."""
    repeats = 3 if quick else 7
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        files = compared_files(Path(folder), quick)
        specs = [f"{f['path']}:{f['form']}:{f['width']}:{f['height']}" for f in files]
        python = os.environ.get("EVIS_PEERS_PYTHON", sys.executable)
        script = [python, str(Path(stream_peers.__file__)), str(repeats), *specs]
        done = subprocess.run(script, capture_output=True, text=True, check=False)
        if done.returncode:
            reason = (done.stderr.strip().splitlines() or ["it died"])[-1]
            return [], f"{python} could not read the files with other libraries: {reason}"
        peers = json.loads(done.stdout.splitlines()[-1])
        for file in files:
            for backend in ("warp", "numpy") if file["form"] != "aedat4" else ("numpy",):
                work = functools.partial(ours, file["path"], backend)
                try:
                    found = stream_peers.digest(*work())
                except ValueError as error:
                    rows.append({"file": file["name"], "reader": "evis", "verdict": str(error)[-80:]})
                    continue
                name = f"evis, {backend}" if file["form"] != "aedat4" else "evis"
                row = {"file": file["name"], "reader": name, "events": found["events"]}
                row["Mev/s"] = rate(found["events"], cpu_seconds(work, repeats))
                rows.append({**row, "verdict": verdict(file["sha256"], found)})
            for name, found in peers["files"][file["path"]].items():
                row = {"file": file["name"], "reader": f"{name} {peers['versions'][name]}"}
                if "error" in found:
                    rows.append({**row, "verdict": f"fails: {found['error']}"})
                    continue
                row |= {"events": found["events"], "Mev/s": rate(found["events"], found["cpu_s"])}
                rows.append({**row, "verdict": verdict(file["sha256"], found)})
    absent = ", ".join(peers["absent"])
    return rows, f"Not installed in {Path(python).name}, so not compared: {absent}." if absent else ""


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures million events per second of CPU time, by stream and decoder; ratios are safer than the numbers."""
    rows, encoding_rows = codec_rows(quick)
    compared, absent = reader_rows(quick)
    command = COMMAND + (" --quick" if quick else "")
    assert set(WORDS) <= set(CODECS)
    return {
        "decoding": {
            "title": "Decoding, million events per second of CPU time",
            "command": command,
            "rows": rows,
            "note": "One core, bytes to arrays t, x, y, p; the Warp kernel and numpy give the same bits.",
        },
        "readers": {
            "title": "Files to arrays, million events per second of CPU time, and who is right",
            "command": command,
            "rows": compared,
            "note": "Right = the SHA-256 of t, x, y, p is that of the events in the file. " + absent,
        },
        "encoding": {"title": "Encoding (numpy)", "command": command, "rows": encoding_rows, "note": ""},
    }


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
