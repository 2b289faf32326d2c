"""Checks this machine and this installation, a function for each check."""

from __future__ import annotations

import ctypes
import os
import platform
import re
import shutil
import socket
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import metadata

EXTRAS = {
    "video": "frames from videos, .mp4 without ffmpeg",
    "bench": "plots",
    "files": "HDF5 compressed as DSEC and TUM-VIE",
    "ros": "rosbags and mcap-ros2-support for your own scripts",
    "gpu": "MuJoCo Warp in physics:=mujoco_warp",
    "gym": "environments for reinforcement learning",
    "rl": "training in them, with PyTorch",
    "layouts": "data sets as Zarr",
    "cluster": "data sets made on a Ray cluster, and kept on s3",
}
"""Optional parts of the installation and what they are for; `usb` has a check of its own."""
MB = 1 << 20


@dataclass
class Finding:
    """Describes the result of one check.

    level: ok, note (something optional is not there) or fail (with the remedy in text).
    """

    name: str
    level: str
    text: str


def check() -> Iterator[Finding]:
    """Yields all findings, one per check; a check that breaks is a failure with its reason."""
    checks: dict[str, Callable[[], Finding]] = {
        "python": _python, "packages": _packages, "extras": _extras, "machine": _machine,
        "shared memory": _shared_memory, "run directory": _run_directory, "processes": _processes, "kernels": _kernels,
        "gpu": _gpu, "libusb": _libusb, "viewer port": _port, "browser": _browser, "data": _data,
        "unsaid": _unsaid,
    }  # fmt: skip
    for name, action in checks.items():
        try:
            yield action()
        except Exception as error:
            yield Finding(name, "fail", f"{type(error).__name__}: {error}")


def _python() -> Finding:
    return Finding("python", "ok", f"{platform.python_version()} on {platform.system()} {platform.machine()}")


def _required(extra: str = "") -> list[str]:
    """Packages that this installation of evis says it needs, or an extra of it."""
    wanted = []
    for line in metadata.requires("evis") or ():
        package, _, marker = line.partition(";")
        named = re.search(r"extra == ['\"]([^'\"]+)", marker)
        if (named[1] if named else "") == extra:
            wanted.append(re.split(r"[^\w.-]", package.strip(), maxsplit=1)[0])
    return wanted


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _packages() -> Finding:
    found = {package: _version(package) for package in _required()}
    if missing := [package for package, version in found.items() if version is None]:
        return Finding("packages", "fail", f"missing: {', '.join(missing)}; install evis again")
    return Finding("packages", "ok", ", ".join(f"{package} {version}" for package, version in found.items()))


def _extras() -> Finding:
    there = [name for name in EXTRAS if (packages := _required(name)) and all(map(_version, packages))]
    text = ", ".join(there)
    if absent := [f"{name} ({what})" for name, what in EXTRAS.items() if name not in there]:
        text += f"{'; ' if text else ''}not installed: {', '.join(absent)}; `pip install 'evis[NAME]'` brings one"
    return Finding("extras", "note" if absent else "ok", text)


def _machine() -> Finding:
    pages = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    cores = len(os.sched_getaffinity(0))
    return Finding("machine", "ok" if cores > 1 else "note", f"{cores} cores, {pages / 2**30:.0f} GiB of memory")


def _shared_memory() -> Finding:
    descriptor = os.memfd_create("evis-doctor")
    try:
        os.posix_fallocate(descriptor, 0, 64 * MB)
        with open(f"/proc/{os.getpid()}/fd/{descriptor}", "rb"):
            pass
    except OSError as error:
        return Finding(
            "shared memory", "fail", f"64 MB could not be had ({error.strerror}); free memory or raise the limit"
        )
    finally:
        os.close(descriptor)
    return Finding("shared memory", "ok", "memfd works and can be opened by other processes")


def _run_directory() -> Finding:
    from evis.client.running import named, running_graphs
    from evis.supervisor.run_directory import root, sweep

    folder = root()
    swept, running = len(sweep()), [named(plan) for plan in running_graphs()]
    text = f"{folder}, {len(running)} graph(s) running" + (f": {', '.join(running)}" if running else "")
    text += f", {swept} dead run(s) swept" if swept else ""
    return Finding("run directory", "ok", text)


def _processes() -> Finding:
    if not sys.platform.startswith("linux") or not hasattr(ctypes.CDLL(None), "prctl"):
        return Finding("processes", "note", "no PDEATHSIG here: a killed launcher may leave its processes behind")
    return Finding("processes", "ok", "children die with their launcher (PDEATHSIG)")


def _kernels() -> Finding:
    import warp as wp

    from evis.warp_start import start_warp

    start_warp()
    cache = wp.config.kernel_cache_dir or ""
    if not os.access(cache, os.W_OK):
        return Finding("kernels", "fail", f"the kernel cache {cache} cannot be written; set WARP_CACHE_PATH")
    return Finding("kernels", "ok", f"warp {wp.__version__}, compiled kernels are kept in {cache}")


def _gpu() -> Finding:
    import warp as wp

    from evis.warp_start import start_warp

    start_warp()  # Warp by itself would start whatever the check of the kernels has found
    names = [f"{d.alias} {d.name}" for d in wp.get_cuda_devices()] if wp.is_cuda_available() else []
    if not names:
        return Finding("gpu", "note", "no CUDA GPU: device:=cpu is what works here")
    return Finding("gpu", "ok", ", ".join(names))


def _libusb() -> Finding:
    from nodes.camera.usb.access import usb_bus

    try:
        usb_bus()
    except OSError as error:
        return Finding("libusb", "note", f"{error}; USB cameras need it, nothing else does")
    return Finding("libusb", "ok", "libusb-1.0 loads")


def _port() -> Finding:
    from evis.web.address import DEFAULT_PORT

    with socket.socket() as probe:
        try:
            probe.bind(("127.0.0.1", DEFAULT_PORT))
        except OSError:
            return Finding("viewer port", "note", f"{DEFAULT_PORT} is taken: the visualizer takes the next free one")
    return Finding("viewer port", "ok", f"{DEFAULT_PORT} is free")


def _browser() -> Finding:
    for name in ("chromium", "chromium-browser", "google-chrome", "firefox"):
        if path := shutil.which(name):
            return Finding("browser", "ok", path)
    return Finding("browser", "note", "none found on this machine: open the page from another one by ssh -L")


def _unsaid() -> Finding:
    from evis.console.unsaid import folder

    try:
        logs = sorted(folder().glob("*.log"))
    except OSError as error:
        return Finding("unsaid", "note", f"what a run cannot print is lost: {error}")
    if not logs:
        return Finding("unsaid", "ok", "every run could tell its user what it had to say")
    return Finding("unsaid", "note", f"{len(logs)} run(s) lost their terminal or pipe; the newest log is {logs[-1]}")


def _data() -> Finding:
    from evis.config import paths

    launch, scenes = paths.names("launch"), paths.names("scenes")
    if not launch or not scenes:
        return Finding("data", "fail", "launch files or scenes are missing; install evis again")
    return Finding("data", "ok", f"launch files: {', '.join(launch)}; scenes: {', '.join(scenes)}")
