"""Measures the camera node end to end: an emulated USB camera that does not wait, driver, decoder, bus and a reader.

    evis bench camera [--quick]

The emulated device offers EVT3 bytes at a steady rate and holds 1 MiB itself; what does not fit is
lost in the camera, as in a real one. Two processes: the camera node (reader thread and decoder) and a node that reads
/cam0/events. The CPU time of the emulated device, which a real camera does not take, is measured inside its bulk read
and stated apart from that of driver, decoder, node and bus in the same process.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from bench import command
from bench.graph.camera_nodes import prepared, turns
from bench.graph.runs import launch

COMMAND = "evis bench camera"
RATES = (20e6, 50e6, 100e6, 200e6)
PACKET_MS = 10.0

GRAPH = """description: a flood
mode: live
nodes:
  camera:
    type: bench.graph.camera_nodes:FloodCameraNode
    params: {{rate: {rate}, seconds: {seconds}, packet_ms: {packet_ms}, out: "{out}"}}
  sink:
    type: bench.graph.camera_nodes:SinkNode
    keep: ["*"]
"""


def flood(rate: float, seconds: float, packet_ms: float) -> dict[str, Any]:
    """Runs the graph once; returns what the camera node measured, and the reader's counters as `read`."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "result.json"
        graph = Path(folder) / "flood.yaml"
        graph.write_text(GRAPH.format(rate=rate, seconds=seconds, packet_ms=packet_ms, out=out))
        summary = launch(str(graph))
        return {**json.loads(out.read_text()), "read": summary["nodes"]["sink"]["counters"]}


def row(rate: float, seconds: float, packet_ms: float) -> dict[str, Any]:
    """Measures the camera node at one offered rate [bytes/s]; returns a row of the table."""
    r = flood(rate, seconds, packet_ms)
    p50, p99, worst = r["latency_ms"]
    return {
        "offered [MB/s]": round(r["offered"] / r["wall_s"] / 1e6, 1),
        "packet [ms]": packet_ms,
        "published [MB/s]": round((r["received"]) / r["wall_s"] / 1e6, 1),
        "read [Mev/s]": round(r["read"].get("events", 0) / r["wall_s"] / 1e6, 1),
        "lost in the camera": f"{100 * r['lost_in_camera'] / r['offered']:.2f} %",
        "lost in the driver": f"{100 * r['lost_in_driver'] / r['offered']:.2f} %",
        "packets marked": r["read"].get("packets_marked", 0),
        "longest pause [ms]": round(r["pause_ms"], 2),
        "intervals joined": r["joined"],
        "CPU of the emulator": f"{100 * r['emulator_cpu_s'] / r['wall_s']:.0f} %",
        "CPU of driver and node": f"{100 * (r['cpu_s'] - r['emulator_cpu_s']) / r['wall_s']:.0f} %",
        "read to published p50 [ms]": round(p50, 2),
        "p99 [ms]": round(p99, 2),
        "worst [ms]": round(worst, 2),
    }


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures sustained rate, losses, CPU share and latency by offered rate."""
    seconds = 2.0 if quick else 5.0
    words = prepared(RATES[-1])
    per_event = words.nbytes / _events_in(words)
    rows = [row(rate, seconds, PACKET_MS) for rate in RATES]
    rows += [row(rate, seconds, 1.0) for rate in RATES[:2]]
    return {
        "camera": {
            "title": "Camera node on an emulated EVK4, from bulk read to a reader in another process",
            "command": COMMAND + (" --quick" if quick else ""),
            "rows": rows,
            "note": f"EVT3 with {per_event:.2f} bytes per event. Latency: from the return of the last bulk read that "
            "is in a packet to the return of its publication; an event waits for the end of its packet besides. Pause: "
            "the longest time in which no read was waiting at the endpoint. Intervals joined: packets not cut "
            "because the host was behind. CPU: 100 % = one core; driver and node with decoder and bus, in one process.",
        }
    }


def _events_in(words: np.ndarray) -> int:
    """Events in the prepared bytes, counted by the decoder."""
    from evis.events.codecs.decoder import decoder_for

    return len(decoder_for("evt3").decode(next(turns(words.copy()))))


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
