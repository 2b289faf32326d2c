"""Compiles the core of ESIM from its own checkout to run it on the same frames, and lists published figures of others.

Nothing of a peer is part of this project. `EVIS_PEERS=DIR`, DIR holding a checkout of uzh-rpg/rpg_vid2e, makes the
benchmark compile esim_py's event_simulator with g++ and run it on the same frames; without it only quoted figures show.
"""

from __future__ import annotations

import ctypes
import functools
import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from bench.event_sensor.signals import SECOND
from evis.events.measure.distance import EventStream

QUOTED = "quoted"
"""Marks a figure that this run did not measure: of the authors' own programs, on another machine."""
SINUSOIDS: dict[int, tuple[tuple[str, float, float, float, float, float | None], ...]] = {
    125: (
        ("rpg_esim, esim_py core", 120, 2214, 2.49, 0, 0.46),
        ("Metavision", 119, 2199, 2.49, 0, 0.51),
        ("esim_py as shipped, 8 bit", 261, 3173, 2.66, 0.18, 0.69),
        ("DVS-Voltmeter, nearly noiseless", 230, 2844, 4.14, 0.03, 2.59),
        ("v2e, ideal", 1481, 6328, 5.56, 3.06, 0.43),
        ("IEBCS C++", 2150, 7462, 13.6, 9.0, 0.65),
        ("EVIS v1.0 released", 1464, 7512, 46.9, 4.4, 0.15),
        ("EVIS paper's equations", 2223, 7659, 11.9, 9.4, None),
    ),
    250: (
        ("rpg_esim, esim_py core", 30.0, 635, 0.92, 0, 0.51),
        ("Metavision", 30.0, 634, 0.92, 0, 0.84),
        ("esim_py as shipped, 8 bit", 144, 2360, 1.24, 0.24, 0.77),
        ("DVS-Voltmeter, nearly noiseless", 68.9, 908, 1.39, 0.01, 3.95),
        ("v2e, ideal", 848, 2621, 0.92, 0, 0.54),
        ("IEBCS C++", 1429, 4002, 5.0, 2.9, 0.82),
        ("EVIS v1.0 released", 1205, 7209, 29.3, 3.1, 0.23),
        ("EVIS paper's equations", 1444, 3943, 4.4, 3.5, None),
    ),
    1000: (
        ("rpg_esim, esim_py core", 1.87, 44.5, 0.17, 0, 0.87),
        ("Metavision", 1.92, 44.0, 0.17, 0, 0.61),
        ("esim_py as shipped, 8 bit", 112, 2319, 0.83, 0.32, 1.48),
        ("DVS-Voltmeter, nearly noiseless", 11.3, 135, 0.24, 0.02, 12.0),
        ("v2e, ideal", 499, 990, 0.17, 0, 0.85),
        ("IEBCS C++", 483, 1035, 0.61, 0.06, 1.94),
        ("EVIS v1.0 released", 891, 5437, 10.6, 0.74, 0.70),
        ("EVIS paper's equations", 499, 990, 0.17, 0, None),
    ),
}
"""By frame rate: median and 99th percentile of the time error [us], missed and extra events [%], CPU seconds."""
DISK = (
    ("rpg_esim core", 248, -1.5),
    ("esim_py core", 258, -0.9),
    ("EVIS v1.0 core", 249, -74.9),
    ("Metavision", 186, -6.2),
    ("IEBCS C++", 80, -6.9),
    ("v2e, ideal", 61, -1.9),
    ("DVS-Voltmeter, nearly noiseless", 12.6, -13.5),
    ("v2e, noisy preset", 35, None),
)
"""Frames per CPU second on the disk and the error of the number of events [%]."""

HEADERS = (
    "opencv2/core/eigen.hpp",
    "opencv2/highgui/highgui.hpp",
    "opencv2/imgproc/imgproc.hpp",
    "opencv2/core/core.hpp",
    "boost/filesystem.hpp",
    "Eigen/Core",
)
STAND_IN = r"""
#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <string>
#include <vector>
enum { CV_32F, CV_64F };
namespace cv {
enum { IMREAD_GRAYSCALE };
struct Mat {  // shares its pixels on assignment, as OpenCV's does
  std::shared_ptr<std::vector<char>> data; int size[2] = {0, 0};
  template <class T> T& at(int y, int x) { return ((T*)data->data())[(size_t)y * size[1] + x]; }
  static Mat zeros(int h, int w, int) {
    Mat m; m.size[0] = h; m.size[1] = w; m.data = std::make_shared<std::vector<char>>((size_t)h * w * 8); return m;
  }
  bool empty() const { return !data; }
  void convertTo(Mat&, int, double) const {}
};
inline Mat operator+(const Mat& m, float) { return m; }
inline void log(const Mat&, Mat&) {}
inline Mat imread(const std::string&, int) { return {}; }
struct VideoCapture {
  VideoCapture(const std::string&) {}
  bool isOpened() { return false; }
  bool read(Mat&) { return false; }
};
}
namespace Eigen {
struct MatrixXd { double d = 0; MatrixXd(size_t, size_t) {} double& operator()(int, int) { return d; } };
}
namespace boost { namespace filesystem {
struct path { path(const std::string&) {} std::string string() const { return {}; } };
struct directory_entry { boost::filesystem::path path() const { return {""}; } };
struct directory_iterator {
  using iterator_category = std::input_iterator_tag; using value_type = directory_entry;
  using difference_type = long; using pointer = directory_entry*; using reference = directory_entry&;
  directory_iterator() {} directory_iterator(const boost::filesystem::path&) {}
  directory_entry operator*() const { return {}; } directory_iterator& operator++() { return *this; }
  bool operator!=(const directory_iterator&) const { return false; }
  bool operator==(const directory_iterator&) const { return true; }
};
}}
"""
SHIM = r"""
#define private public
#include "esim.cpp"
struct Run { EventSimulator sim; std::vector<Event> events; };
extern "C" void* begin(float c) { return new Run{EventSimulator(c, c, 0, 0, false), {}}; }
extern "C" long frame(void* r, const float* log_image, int h, int w, double t) {
  cv::Mat m; m.size[0] = h; m.size[1] = w;
  m.data = std::make_shared<std::vector<char>>((const char*)log_image, (const char*)(log_image + (size_t)h * w));
  ((Run*)r)->sim.imageCallback(m, t, ((Run*)r)->events);
  return ((Run*)r)->events.size();
}
extern "C" void take(void* r, double* t, int* x, int* y, int* p) {
  for (const Event& e : ((Run*)r)->events) { *t++ = e.t_; *x++ = e.x_; *y++ = e.y_; *p++ = e.polarity_; }
}
extern "C" void end(void* r) { delete (Run*)r; }
"""


class EsimCore:
    """Runs esim_py's event generation on log images in memory, one frame a call, its sorting included."""

    def __init__(self, library: Path) -> None:
        self._c: Any = ctypes.CDLL(str(library))
        self._c.begin.restype = ctypes.c_void_p
        self._c.begin.argtypes = [ctypes.c_float]
        pointer = ctypes.c_void_p
        self._c.frame.argtypes = [pointer, pointer, ctypes.c_int, ctypes.c_int, ctypes.c_double]
        self._c.frame.restype = ctypes.c_long
        self._c.take.argtypes = [pointer] * 5
        self._c.end.argtypes = [pointer]

    def begin(self, threshold: float) -> None:
        """Begins a new sequence."""
        self._run = self._c.begin(threshold)
        self._count = 0

    def frame(self, luminance: np.ndarray, t: int) -> None:
        """Takes one frame, linear float32 [H, W], at t ns."""
        log = np.log(luminance)
        self._count = self._c.frame(self._run, log.ctypes.data, *log.shape, t / SECOND)
        self._shape = log.shape

    def end(self) -> EventStream:
        """Returns all events of the sequence, in ESIM's own order."""
        n = self._count
        t, (x, y, p) = np.empty(n), (np.empty(n, np.int32) for _ in range(3))
        self._c.take(self._run, *(a.ctypes.data for a in (t, x, y, p)))
        self._c.end(self._run)
        stamps = np.rint(t * SECOND).astype(np.int64)
        on = (p > 0).astype(np.uint8)
        return EventStream(stamps, x.astype(np.uint16), y.astype(np.uint16), on, self._shape[1], self._shape[0])


@functools.cache
def esim_core() -> EsimCore | None:
    """Builds ESIM's core from the checkout in EVIS_PEERS; None where there is none. Raises OSError if that fails."""
    folder = os.environ.get("EVIS_PEERS")
    source = next(Path(folder).glob("**/esim_py/src/esim.cpp"), None) if folder else None
    compiler = shutil.which("g++") or shutil.which("c++")
    if source is None or compiler is None:
        return None
    with tempfile.TemporaryDirectory() as build:
        for name in HEADERS:
            header = Path(build, name)
            header.parent.mkdir(parents=True, exist_ok=True)
            header.touch()
        Path(build, "stand_in.h").write_text(STAND_IN)
        Path(build, "shim.cpp").write_text(SHIM)
        library = Path(build, "esim.so")
        command = [compiler, "-O3", "-DNDEBUG", "-std=c++17", "-shared", "-fPIC", "-include", "stand_in.h",
                   "-I", build, "-I", str(source.parent), "-I", str(source.parent.parent / "include"),
                   "shim.cpp", "-o", str(library)]  # fmt: skip
        done = subprocess.run(command, cwd=build, capture_output=True, text=True)
        if done.returncode:
            raise OSError(f"{source} does not build: {done.stderr.strip().splitlines()[0]}")
        return EsimCore(library)
