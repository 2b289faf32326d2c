"""Makes the sections of the report on whole runs, each with its title and what its columns are."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import warp as wp

from bench.roofline import ceilings
from bench.throughput import errors, sensors
from bench.throughput.attempts import Limits
from bench.throughput.cases import CASES, DEFAULTS, ROOFS, SIZE, SMALL, STARTS, chosen
from bench.throughput.tables import AUDITED, DEFAULT_S, default_row, frames_row, kernel_rows, roofline_rows, start_row


@dataclass(frozen=True)
class Measurement:
    """Describes what is to be measured: the device, words of the rows, and how long it may take."""

    device: str
    words: Sequence[str]
    quick: bool
    limits: Limits

    @property
    def where(self) -> str:
        """Gives the end of a title: size, processes and name of the device."""
        return f"640x480, one process, {wp.get_device(self.device).name}"


def frames(m: Measurement) -> dict[str, Any]:
    """Measures runs of frames, of some with samples between them, and lists what their time goes to on the device."""
    found = [frames_row(case, m.device, m.limits) for case in chosen(CASES, m.words, m.quick)]
    times = {row["run"]: row.pop("recorded") for row in found}
    note = (
        "Of the windows of all runs. env-s/s: simulated seconds of all environments together in a second. host: time "
        "of a gap without that in which the host waited for the GPU. device: time in which it did anything, "
        "a CPU in kernels. device alone: the rate if it were never idle. limit: what takes most of a gap, a node and "
        "its share of the host's time, or a kernel and its share of a device that is busy."
    )
    return {
        "frames": {
            "title": f"Frames alone unless a tolerance of time is named (audit:=0), {m.where}",
            "rows": found,
            "note": note,
        },
        "kernels": {"title": f"What the device's time goes to, {m.where}", "rows": kernel_rows(times), "note": ""},
    }


def defaults(m: Measurement) -> dict[str, Any]:
    """Measures runs as they are by default."""
    rows = [default_row(case, m.device, m.limits) for case in chosen(DEFAULTS, m.words, m.quick)]
    seconds = DEFAULT_S[m.device == "cpu"]
    note = (
        f"Real-time factor of {seconds:g} simulated seconds after start-up; VP, from, to: as the audit has it, where "
        f"there is none by default (on a GPU) as one of {AUDITED} pixels has it, in a run of its own."
    )
    return {"defaults": {"title": f"Defaults, {m.where}", "rows": rows, "note": note}}


def starts(m: Measurement) -> dict[str, Any]:
    """Measures the time from a command to its first event, with kernels compiled anew and from a cache."""
    rows = [start_row(case, m.device, m.limits) for case in chosen(STARTS, m.words, m.quick)]
    note = "Kernels compiled anew, and found in Warp's cache."
    return {"starts": {"title": f"From the command to the first event, {m.where}", "rows": rows, "note": note}}


def roofline(m: Measurement) -> dict[str, Any]:
    """Measures the peak rates of the device, and compares the kernels of some runs with them."""
    cases = chosen(ROOFS, m.words, m.quick)
    if not cases:
        return {}
    top = ceilings.measured(m.device)
    rates = [
        {"what": "memory, a copy [GB/s]", "rate": round(top.memory / 1e9, 1)},
        {"what": "caches, reading [GB/s]", "rate": round(top.cache / 1e9, 1)},
        {"what": "float32, products and sums [Gop/s]", "rate": round(top.operations / 1e9, 1)},
    ]
    rows = [row for case in cases for row in roofline_rows(case, m.device, m.limits, top)]
    note = (
        "MB: of arrays, read and written by the code of the kernels, whether from memory or from caches. "
        "Mop: arithmetic of any type, a root or logarithm as one. of the roof: the time that the caches or the "
        "arithmetic would take at least, over the time that was taken."
    )
    return {
        "ceilings": {
            "title": f"What can be attained, {m.where}",
            "rows": rates,
            "note": "As Warp's kernels attain it.",
        },
        "roofline": {"title": f"Kernels against the roof, {m.where}", "rows": rows, "note": note},
    }


def sensors_of_others(m: Measurement) -> dict[str, Any]:
    """Measures our event sensor beside those of others, which EVIS_PEERS names."""
    if m.words:
        return {}
    title = f"Event sensors, frames a second of an HDR disk, 640x480 at 1 kHz, {wp.get_device(m.device).name}"
    note = "Frames are on the device before, and events stay there. The best of some rounds."
    return {"sensors": {"title": title, "rows": sensors.rows(m.device, m.quick), "note": note}}


def errors_against_time(m: Measurement) -> dict[str, Any]:
    """Measures the error of events and the run time of eight scenes; quick: of one, on a CPU of small images."""
    size, words = SMALL if m.quick and m.device == "cpu" else SIZE, m.words or (("disk",) if m.quick else ())
    hz, every = errors.RATE * errors.TRUTH, errors.APART
    note = (
        f"Error: Victor-Purpura at 1/ms against dense rendering at {hz} Hz on the same device, of one in {every} rows "
        f"and columns, {errors.GAPS} gaps. Run time: of 1/{errors.RATE} s, of a graph in one process, where nobody "
        "waits for single keyframes. With further samples: time_tolerance, and K as upsampling:=auto has it."
    )
    title = f"Error against run time, {size[0]}x{size[1]}, one process, {wp.get_device(m.device).name}"
    found = list(errors.rows(words, size, m.device, m.limits))
    return {"errors": {"title": title, "rows": found, "note": note}}


SECTIONS: Mapping[str, Callable[[Measurement], dict[str, Any]]] = {
    "frames": frames,
    "defaults": defaults,
    "starts": starts,
    "roofline": roofline,
    "sensors": sensors_of_others,
    "errors": errors_against_time,
}
"""Name -> what measures it, which may give more sections than one."""
